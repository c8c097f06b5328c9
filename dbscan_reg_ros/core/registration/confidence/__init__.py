# SPDX-License-Identifier: Apache-2.0
"""Confidence of a registration: the evidence for a motion, and a statistical model of it."""
