# SPDX-License-Identifier: Apache-2.0
"""What the node exchanges with the graph: scans, priors, outputs, services, parameters, diagnostics, log."""
