# SPDX-License-Identifier: Apache-2.0
"""Playing a recording to a running node, and what it answers."""
