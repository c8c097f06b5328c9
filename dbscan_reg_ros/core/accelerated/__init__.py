# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the registration and of the map: `steps` is one Cython extension."""
