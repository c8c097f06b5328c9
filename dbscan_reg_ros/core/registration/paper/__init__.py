# SPDX-License-Identifier: Apache-2.0
"""The literal variants of the paper, chosen by parameters."""
