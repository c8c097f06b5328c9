# SPDX-License-Identifier: Apache-2.0
"""The key frames, the local map, and the alignment of a scan with them."""
