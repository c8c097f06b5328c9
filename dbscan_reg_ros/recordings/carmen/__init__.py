# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs: their lines, and what has to be known of a whole log."""
