# SPDX-License-Identifier: Apache-2.0
"""Search for the parameter values that minimise a cost on given recordings."""
