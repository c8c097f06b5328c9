# SPDX-License-Identifier: Apache-2.0
"""Key frames, the local map that contains their points, and the alignment of a scan with the map."""
