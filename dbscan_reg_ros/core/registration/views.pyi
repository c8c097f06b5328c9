# SPDX-License-Identifier: Apache-2.0
"""Views of segments and likelihood fields, which are kept with them."""
