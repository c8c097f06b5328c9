# SPDX-License-Identifier: Apache-2.0
"""Localisation in a map: floors, starts and what must hold."""
