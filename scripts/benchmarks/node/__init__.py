# SPDX-License-Identifier: Apache-2.0
"""The running node: latency, load and long drives."""
