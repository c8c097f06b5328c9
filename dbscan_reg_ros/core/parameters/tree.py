# SPDX-License-Identifier: Apache-2.0
"""All parameters as one tree; a full name is ``group.field``."""
import dataclasses
from dataclasses import dataclass
from functools import cached_property

from ..errors import ParameterError
from .features import RingBandParameters, ScanParameters, SegmentParameters
from .odometry import ManhattanParameters, OdometryParameters, PriorParameters, TimeParameters
from .registration import (
    _MOST,
    DecisionParameters,
    DensityParameters,
    DivergenceParameters,
    FreeDirectionParameters,
    RefinementParameters,
    RotationParameters,
    SelectionParameters,
    TranslationParameters,
)
from .schema import ParameterTree

_LIMITED = ('scan', 'range'), ('scan', 'noise'), ('rotation', 'eps'), ('translation', 'eps')
"""Group and name of what has a least and a greatest value, each a parameter; a greatest one of 0 is none."""


@dataclass(frozen=True)
class Parameters(ParameterTree):
    """All parameters of the registration and the odometry."""

    scan: ScanParameters = dataclasses.field(default_factory=ScanParameters)
    filter: RingBandParameters = dataclasses.field(default_factory=RingBandParameters)
    segments: SegmentParameters = dataclasses.field(default_factory=SegmentParameters)
    rotation: RotationParameters = dataclasses.field(default_factory=RotationParameters)
    translation: TranslationParameters = dataclasses.field(default_factory=TranslationParameters)
    density: DensityParameters = dataclasses.field(default_factory=DensityParameters)
    selection: SelectionParameters = dataclasses.field(default_factory=SelectionParameters)
    divergence: DivergenceParameters = dataclasses.field(default_factory=DivergenceParameters)
    refinement: RefinementParameters = dataclasses.field(default_factory=RefinementParameters)
    degeneracy: FreeDirectionParameters = dataclasses.field(default_factory=FreeDirectionParameters)
    decision: DecisionParameters = dataclasses.field(default_factory=DecisionParameters)
    prior: PriorParameters = dataclasses.field(default_factory=PriorParameters)
    odometry: OdometryParameters = dataclasses.field(default_factory=OdometryParameters)
    manhattan: ManhattanParameters = dataclasses.field(default_factory=ManhattanParameters)
    time: TimeParameters = dataclasses.field(default_factory=TimeParameters)

    def __post_init__(self):
        super().__post_init__()
        for group, name in _LIMITED:
            least, greatest = (getattr(getattr(self, group), f'{name}_{end}') for end in ('min', 'max'))
            if 0.0 < greatest < least:
                raise ParameterError(f'{group}.{name}_min = {least}: expected at most {group}.{name}_max, which is {greatest}; '
                                     'set both at once, or first the one that still fits')

    @cached_property
    def widened(self):
        """The same with a search of more hypotheses, which is not repeated."""
        more = self.selection.wide_search_factor
        rotation = dataclasses.replace(self.rotation, max_hypotheses=min(more * self.rotation.max_hypotheses, _MOST))
        candidates = min(more * self.selection.max_clusters_with_prior, _MOST)
        selection = dataclasses.replace(self.selection, wide_search_factor=1, preselected=min(more * self.selection.preselected, _MOST),
                                        max_clusters_with_prior=candidates, max_clusters=candidates)
        return dataclasses.replace(self, rotation=rotation, selection=selection)
