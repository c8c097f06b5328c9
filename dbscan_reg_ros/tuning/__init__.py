# SPDX-License-Identifier: Apache-2.0
"""The search for parameters that suit given recordings."""
