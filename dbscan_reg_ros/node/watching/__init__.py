# SPDX-License-Identifier: Apache-2.0
"""Listener to a running node for the live page."""
