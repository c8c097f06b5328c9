# SPDX-License-Identifier: Apache-2.0
"""All parameters as one tree (a full name is ``group.field``), and bounds between two parameters."""
import dataclasses
from dataclasses import dataclass
from functools import cached_property

from ..errors import ParameterError, expect
from .features import RingBandParameters, ScanParameters, SegmentParameters
from .odometry import ManhattanParameters, OdometryParameters, PriorParameters, TimeParameters
from .registration import (
    MAX_COUNT,
    DecisionParameters,
    DegeneracyParameters,
    DensityParameters,
    RefinementParameters,
    RotationParameters,
    SelectionParameters,
    TranslationParameters,
)
from .schema import ADVANCED, ParameterTree

_LIMITED = ('scan', 'range'), ('scan', 'noise')
"""Group and name of quantities with parameters for their lower and upper limit; an upper limit of 0 means no limit."""


@dataclass(frozen=True, repr=False)
class Parameters(ParameterTree):
    """All parameters of the registration and the odometry."""

    scan: ScanParameters = dataclasses.field(default_factory=ScanParameters)
    filter: RingBandParameters = dataclasses.field(default_factory=RingBandParameters)
    segments: SegmentParameters = dataclasses.field(default_factory=SegmentParameters)
    rotation: RotationParameters = dataclasses.field(default_factory=RotationParameters)
    translation: TranslationParameters = dataclasses.field(default_factory=TranslationParameters)
    density: DensityParameters = dataclasses.field(default_factory=DensityParameters)
    selection: SelectionParameters = dataclasses.field(default_factory=SelectionParameters)
    refinement: RefinementParameters = dataclasses.field(default_factory=RefinementParameters)
    degeneracy: DegeneracyParameters = dataclasses.field(default_factory=DegeneracyParameters)
    decision: DecisionParameters = dataclasses.field(default_factory=DecisionParameters)
    prior: PriorParameters = dataclasses.field(default_factory=PriorParameters)
    odometry: OdometryParameters = dataclasses.field(default_factory=OdometryParameters)
    manhattan: ManhattanParameters = dataclasses.field(default_factory=ManhattanParameters)
    time: TimeParameters = dataclasses.field(default_factory=TimeParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        for group, name in _LIMITED:
            least, greatest = (getattr(getattr(self, group), f'{name}_{end}') for end in ('min', 'max'))
            if 0.0 < greatest < least:
                known = {each.name.removeprefix(ADVANCED): each.name for each in self.describe()}
                low, high = (known[f'{group}.{name}_{end}'] for end in ('min', 'max'))
                raise ParameterError(f'{low} = {least}: expected at most {high}, which is {greatest}; '
                                     'set both at once, or change the other limit first')

    @cached_property
    def widened(self) -> 'Parameters':
        """The parameters of the wide search: more hypotheses, and no further wide search."""
        s, factor = self.selection, self.selection.wide_search_factor
        return dataclasses.replace(
            self,
            rotation=dataclasses.replace(
                self.rotation, max_hypotheses=min(factor * self.rotation.max_hypotheses, MAX_COUNT)),
            selection=dataclasses.replace(
                s, wide_search_factor=1, preselected=min(factor * s.preselected, MAX_COUNT),
                max_clusters=min(factor * s.max_clusters, MAX_COUNT), min_support_ratio=0.5 * s.min_support_ratio))


def expect_parameters(value: object) -> None:
    """Raise ParameterError if a `value` given as parameters is none."""
    expect('parameters', value, Parameters,
           "Parameters().replace({'scan.range_max': 20.0}), or read_parameters(FILE).for_odometry()", ParameterError)
