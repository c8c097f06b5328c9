# SPDX-License-Identifier: Apache-2.0
"""The robot in a map: localisation and mapping; imported only where ``map.mode`` asks for it."""
