# SPDX-License-Identifier: Apache-2.0
"""Maps of key frames, and the pose of a robot in them."""
