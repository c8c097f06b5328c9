# SPDX-License-Identifier: Apache-2.0
"""Compiled counterparts of whole steps, with the names of the numpy reference: `steps` is one Cython extension."""
