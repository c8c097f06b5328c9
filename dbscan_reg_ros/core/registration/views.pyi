# SPDX-License-Identifier: Apache-2.0
"""Views of scans and look-up tables, which are kept with them."""
