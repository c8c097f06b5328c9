# SPDX-License-Identifier: Apache-2.0
"""What the node says of itself and of the graph: diagnostics, counters, log."""
