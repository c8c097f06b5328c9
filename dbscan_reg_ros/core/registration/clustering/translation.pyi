# SPDX-License-Identifier: Apache-2.0
"""Translation hypotheses (section 2.2.2, Eq. 10-15)."""
from ...features.records import Segments
from ...geometry.array_types import FloatArray
from ...parameters.registration import TranslationParameters
from ..hypotheses import Rotations, Translations
from ..problem import Problem
from ..records import Prior

def estimate_translations(
    reference: Segments,
    current: Segments,
    rotations: Rotations,
    weights: FloatArray,
    parameters: TranslationParameters,
) -> Translations: ...
def heaviest_motions(problem: Problem) -> tuple[FloatArray, FloatArray]: ...
def near_motions(problem: Problem, prior: Prior) -> FloatArray: ...
