# SPDX-License-Identifier: Apache-2.0
"""Page of a replay: one file that opens in any browser, without a network."""
