# SPDX-License-Identifier: Apache-2.0
"""From a scan to its features: range noise, ring band filter, segments, normals, likelihood field, free space."""
