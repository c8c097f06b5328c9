# SPDX-License-Identifier: Apache-2.0
"""The figures of the paper for one pair of scans: the result of each step of the method."""
