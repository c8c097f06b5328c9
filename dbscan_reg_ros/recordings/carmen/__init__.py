# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs: reading and writing of lines, and properties of a whole log."""
