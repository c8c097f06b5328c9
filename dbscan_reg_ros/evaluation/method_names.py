# SPDX-License-Identifier: Apache-2.0
"""Names of the methods that can be compared, and when they take key frames; this module loads none of the methods."""

METHODS = ('dbscan', 'paper', 'small_gicp', 'kiss-icp', 'icp', 'idc', 'icl', 'identity')
KEY_FRAME_DISTANCE, KEY_FRAME_DEGREES = 0.3, 15.0
"""A scan becomes the key frame of `trackers.KeyFrames` if it is farther than this from the last one [m], [deg]."""
