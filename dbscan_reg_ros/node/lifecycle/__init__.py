# SPDX-License-Identifier: Apache-2.0
"""How a node is started, spun and ended; the lifecycle node."""
