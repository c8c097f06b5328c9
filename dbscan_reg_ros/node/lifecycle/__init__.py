# SPDX-License-Identifier: Apache-2.0
"""Start, spin and end of a node; the lifecycle node."""
