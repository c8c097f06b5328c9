# SPDX-License-Identifier: Apache-2.0
"""Tables of a scan as a reference: its likelihood field (Eq. 16-18) and its free-space profile."""
from ..geometry.array_types import FloatArray
from ..parameters.registration import DensityParameters
from .free_space import FreeSpaceProfile
from .likelihood_field import LikelihoodField
from .oriented_points import OrientedPoints

def build_likelihood_field(oriented: OrientedPoints, parameters: DensityParameters) -> LikelihoodField: ...
def build_free_space_profile(points: FloatArray, increment: float) -> FreeSpaceProfile: ...
