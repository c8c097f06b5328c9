# SPDX-License-Identifier: Apache-2.0
"""From the features of two scans to their relative motion (Figure 13)."""
