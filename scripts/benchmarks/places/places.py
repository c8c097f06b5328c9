# SPDX-License-Identifier: Apache-2.0
"""How often, how soon and how rightly a start is found in a map, and what is said where there is none."""
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.evaluation.metrics import path_lengths
from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.recordings import data_folder, open_recording
from dbscan_reg_ros.simulation import Lidar

from ..bounds import at_least, at_most
from ..intel import Intel
from ..report import Report
from .starts import COVERED, Mapped, floor_drive, floor_map, followed

LIDARS = {'360': Lidar(beams=360, angle_min=-math.pi, rate=5.0), '180': Lidar(rate=8.0)}
"""Field of view [deg] -> lidar on the simulated floors."""
SEARCH, OUTSIDE = 3.0, 10.0
"""Distance [m] within which a start is to be found, and after which a start outside is to be recognised."""
BOUNDS = {'intel': {'right': at_least(0.95), 'wrong_count': at_most(0), 'mean_m': at_most(0.05),
                    'mean_deg': at_most(0.5)},
          'floors': {'right': at_least(0.97), 'wrong_count': at_most(0), 'mean_m': at_most(0.02)},
          'changed': {'right': at_least(0.9), 'wrong_count': at_most(0)},
          'outside': {'claimed_count': at_most(0), 'said_outside': at_least(0.8)}}


def summary(outcomes) -> dict:
    """Return the measures of starts inside a map."""
    metres = np.array([each.metres() for each in outcomes])
    wrong = np.array([each.wrong() for each in outcomes])
    errors = np.vstack([each.errors[each.localised] for each in outcomes])
    return {'starts_count': len(outcomes), 'right': float(((metres <= SEARCH) & ~wrong).mean()),
            'wrong_count': int(wrong.sum()), 'median_way_m': float(np.median(metres)),
            'mean_m': float(errors[:, 0].mean()), 'mean_deg': math.degrees(errors[:, 1].mean())}


def outside_summary(outcomes) -> dict:
    """Return the measures of starts outside a map."""
    return {'starts_count': len(outcomes), 'claimed_count': sum(bool(len(each.localised)) for each in outcomes),
            'said_outside': float(np.mean([State.NOT_IN_MAP in each.states for each in outcomes]))}


class IntelHalves:
    """The two halves of the Intel log: the map of one, and starts in the other."""

    def __init__(self, intel):
        self.scans, self.truth = intel.scans, np.column_stack((intel.reference[:, :2], wrap(intel.reference[:, 2])))
        half = len(self.scans) // 2
        self.parts = slice(0, half), slice(half, None)
        self.maps = [Mapped.of(self.scans[part], self.truth[part]) for part in self.parts]

    def starts(self, number, metres, count, within):
        """Yield `count` slices of the other half than that of a map, `metres` long, all of them `within` it or not."""
        low, high, _ = self.parts[1 - number].indices(len(self.scans))
        distance = self.maps[number].distance(self.truth)
        left = count
        for first in np.random.default_rng(number).permutation(np.arange(low, high)):
            way = path_lengths(self.truth[first:high])
            last = first + int(np.searchsorted(way, metres))
            if last >= high or (within and distance[first:last].max() > COVERED):
                continue
            yield slice(first, min(last + 20, high))
            left -= 1
            if not left:
                return

    def inside(self, count):
        """Return the outcomes of starts inside."""
        return [followed(known.localizer, self.scans[part], known.true_poses(self.truth[part]), SEARCH)
                for number, known in enumerate(self.maps) for part in self.starts(number, SEARCH, count // 2, True)]

    def removed(self, count):
        """Return the outcomes of starts whose surroundings are not in the map."""
        found = []
        for number, known in enumerate(self.maps):
            for part in self.starts(number, OUTSIDE, count // 2, False):
                left = known.without(self.truth[part])
                if len(left.known.views) > len(known.known.views) // 4:
                    found.append(followed(left.localizer, self.scans[part], None, OUTSIDE))
        return found

    def other_building(self, scans, count):
        """Return the outcomes of starts in another building."""
        firsts = np.random.default_rng(0).integers(0, len(scans) - 100, count)
        return [followed(self.maps[k % 2].localizer, scans[first:first + 400], None, OUTSIDE)
                for k, first in enumerate(firsts)]


def measure(args) -> Report:
    """Measure; ``--limit N`` takes at most N starts of each kind."""
    report, inside, outside = Report(), {}, {}
    count = args.limit or 100
    halves = IntelHalves(Intel.below(args.data))
    inside['intel'] = summary(halves.inside(count))
    aces = list(open_recording(data_folder(args.data) / 'aces' / 'aces.log.gz').scans())
    outside['intel removed'] = outside_summary(halves.removed(count))
    outside['aces in intel'] = outside_summary(halves.other_building(aces, count))
    for degrees, lidar in LIDARS.items():
        maps = {seed: floor_map(seed, lidar) for seed in range(args.seeds)}
        for name, changed in (('floors', False), ('changed', True)):
            drives = [(known, floor_drive(seed, lidar, number, SEARCH, changed)) for seed, known in maps.items()
                      for number in range(count // args.seeds)]
            inside[f'{name} {degrees}'] = summary([followed(known.localizer, scans, known.true_poses(truth), SEARCH)
                                                   for known, (scans, truth) in drives])
        other = [(maps[seed], floor_drive(seed + args.seeds, lidar, number, OUTSIDE)) for seed in maps
                 for number in range(count // args.seeds)]
        outside[f'another floor {degrees}'] = outside_summary([followed(known.localizer, scans, None, OUTSIDE)
                                                               for known, (scans, _) in other])
    report.add_courses('inside', inside, bounds={name: BOUNDS[name.split()[0]] for name in inside})
    report.add_courses('outside', outside, bounds=dict.fromkeys(outside, BOUNDS['outside']))
    return report
