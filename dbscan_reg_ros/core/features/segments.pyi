# SPDX-License-Identifier: Apache-2.0
"""Line segments of a scan: corners (Eq. 6), line fits (Eq. 7) and the kinds of their ends (section 2.2)."""
from ..geometry.array_types import FloatArray
from ..parameters.features import SegmentParameters
from .oriented_points import PointSequence
from .records import Segments

def extract_segments(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> Segments: ...
