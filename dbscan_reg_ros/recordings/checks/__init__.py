# SPDX-License-Identifier: Apache-2.0
"""Checks of scans: as a driver sends them, and as a program makes them of arrays."""
