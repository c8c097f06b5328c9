# SPDX-License-Identifier: Apache-2.0
"""Small objects of a scan, and poles: small objects without normals, such as chair legs and tree trunks."""
from ..parameters.features import SegmentParameters
from .records import Features
from .small_objects import SmallObjects

def find_small_objects(features: Features, size: float, parameters: SegmentParameters) -> SmallObjects: ...
def with_poles(features: Features, size: float, parameters: SegmentParameters) -> Features: ...
