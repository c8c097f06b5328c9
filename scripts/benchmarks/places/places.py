# SPDX-License-Identifier: Apache-2.0
"""How often, how soon and how rightly a start is found in a map, and what is said where there is none.

A robot that believes a wrong place drives into walls: no start may be wrong, and none outside the map may be claimed.
Not to know is right for a while.
"""
import itertools
import math
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.evaluation.metrics import path_lengths
from dbscan_reg_ros.places.grid import RESOLUTION
from dbscan_reg_ros.places.localizer import Localizer, State
from dbscan_reg_ros.places.map_files import load_grid
from dbscan_reg_ros.recordings import data_folder, open_recording
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.occupancy_map import write_occupancy_map
from dbscan_reg_ros.simulation import Lidar

from ..intel import Intel
from ..report import Report, at_least, at_most
from .floors import comes_to_an_end, floor, route
from .starts import COVERED, PARAMETERS, RIGHT, Mapped, first_answer, floor_drive, floor_map, followed, kidnapped
from .vote import Vote

LIDARS = {'360': Lidar(beams=360, angle_min=-math.pi, rate=5.0), '180': Lidar(rate=8.0)}
"""Field of view [deg] -> lidar on the simulated floors."""
SEARCH, OUTSIDE = 3.0, 10.0
"""Distance [m] within which a start is to be found, and after which a start outside is to be recognised."""
SEEN = 8.0
"""A drive of `OUTSIDE` that comes to the end of a wing within this distance [m] has seen what differs."""
SURE, AGAIN = 0.5, 5.0
"""Standard deviation [m] below which a wrong pose counts; distance [m] within which the pose is to be found again."""
BOUNDS = {'intel': {'right': at_least(0.95), 'wrong_count': at_most(0), 'mean_m': at_most(0.05),
                    'mean_deg': at_most(0.5)},
          'floors': {'right': at_least(0.97), 'wrong_count': at_most(0), 'mean_m': at_most(0.02)},
          'grid': {'right': at_least(0.92), 'wrong_count': at_most(0)},
          'kidnapped': {'again': at_least(1.0), 'wrong_s': at_most(1.0)},
          'changed': {'right': at_least(0.9), 'wrong_count': at_most(0)},
          'wings': {'wrong_count': at_most(0), 'ambiguous': at_least(0.8)},
          'ends': {'wrong_count': at_most(0)},
          'localiser': {'wrong_count': at_most(0), 'claimed_count': at_most(0)}, 'vote': {},
          'outside': {'claimed_count': at_most(0), 'said_outside': at_least(0.8)}}


def summary(outcomes) -> dict:
    """Return the measures of starts inside a map."""
    metres = np.array([each.metres() for each in outcomes])
    wrong = np.array([each.wrong() for each in outcomes])
    errors = np.vstack([each.errors[each.localised] for each in outcomes])
    return {'starts_count': len(outcomes), 'right': float(((metres <= SEARCH) & ~wrong).mean()),
            'among_ten': float(np.mean([each.among_ten for each in outcomes])), 'wrong_count': int(wrong.sum()),
            'median_way_m': float(np.median(metres)), 'ms_worst': max(each.milliseconds for each in outcomes),
            'mean_m': float(errors[:, 0].mean()), 'mean_deg': math.degrees(errors[:, 1].mean())}


def outside_summary(outcomes) -> dict:
    """Return the measures of starts outside a map."""
    return {'starts_count': len(outcomes), 'claimed_count': sum(bool(len(each.localised)) for each in outcomes),
            'said_outside': float(np.mean([State.NOT_IN_MAP in each.states for each in outcomes]))}


def wings_summary(outcomes) -> dict:
    """Return the measures of starts of which another place looks exactly alike."""
    return {'starts_count': len(outcomes), 'wrong_count': sum(each.wrong() for each in outcomes),
            'ambiguous': float(np.mean([State.AMBIGUOUS in each.states for each in outcomes])),
            'found': float(np.mean([bool(len(each.localised)) for each in outcomes]))}


def kidnapped_summary(outcomes, firsts, rate) -> dict:
    """Return the measures of drives whose scans from number ``firsts`` on are elsewhere, `rate` [Hz] of them."""
    again, seconds = [], []
    for each, first in zip(outcomes, firsts, strict=True):
        wrong = (each.errors > RIGHT).any(axis=1)
        seconds.append((wrong & (each.sigmas < SURE)).sum() / rate)
        right = np.flatnonzero([state is State.LOCALISED for state in each.states[first:]] & ~wrong[first:])
        again.append(each.way[first + right[0]] - each.way[first] if len(right) else math.inf)
    return {'starts_count': len(outcomes), 'again': float((np.array(again) <= AGAIN).mean()),
            'wrong_s': float(max(seconds))}


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

    def inside(self, count, folder=None):
        """Return the outcomes of starts inside; with a `folder`, in occupancy grids that are written there."""
        found = []
        for number, known in enumerate(self.maps):
            localizer, truth = known.localizer, known.true_poses(self.truth)
            if folder:
                poses, scans = truth[self.parts[number]], self.scans[self.parts[number]]
                write_occupancy_map(folder, ((pose, SE2.from_array(pose).apply(extract_features(scan).points))
                                             for pose, scan in zip(poses, scans, strict=True)), RESOLUTION)
                localizer = Localizer(load_grid(folder / 'map.yaml'), PARAMETERS)
            found += [followed(localizer, self.scans[part], truth[part], SEARCH)
                      for part in self.starts(number, SEARCH, count // 2, True)]
        return found

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


class Maps:
    """The maps of all parts, each made when it is needed first; `count` starts of each kind, `seeds` floors."""

    def __init__(self, data, count, seeds):
        self.data, self.count, self.seeds = data, count, range(seeds)
        self.each = max(count // seeds, 1)

    @cached_property
    def halves(self) -> IntelHalves:
        """The halves of the Intel log."""
        return IntelHalves(Intel.below(self.data))

    @cached_property
    def aces(self) -> list:
        """The scans of another building."""
        return list(open_recording(data_folder(self.data) / 'aces' / 'aces.log.gz').scans())

    @cached_property
    def floors(self) -> dict:
        """Field of view -> seed -> `Mapped`."""
        return {degrees: {seed: floor_map(seed, lidar) for seed in self.seeds} for degrees, lidar in LIDARS.items()}

    def inside(self, changed):
        """Return field of view -> the outcomes of starts on the floors."""
        return {degrees: [followed(known.localizer, scans, known.true_poses(truth), SEARCH)
                          for seed, known in floors.items() for number in range(self.each)
                          for scans, truth in [floor_drive(seed, LIDARS[degrees], number, SEARCH, changed)]]
                for degrees, floors in self.floors.items()}


def of_intel(maps) -> dict:
    """Starts in one half of the Intel log, in the map of the other."""
    return {'intel': summary(maps.halves.inside(maps.count))}


def of_vote(maps) -> dict:
    """The localiser beside a plain vote: starts in one half of the Intel log, in the map of the other, and in ACES."""
    halves, found = maps.halves, {}
    inside = [(number, part) for number in range(2) for part in halves.starts(number, SEARCH, maps.count // 2, True)]
    firsts = np.random.default_rng(0).integers(0, len(maps.aces) - 100, maps.count)
    for name, answers in (('localiser', [partial(first_answer, known.localizer) for known in halves.maps]),
                          ('vote', [Vote(known.known).answer for known in halves.maps])):
        begin, offs = process_time(), []
        for number, part in inside:
            last, pose = answers[number](halves.scans[part])
            truth = halves.maps[number].true_poses(halves.truth[part][last:last + 1])
            if pose is not None:
                offs.append(relative(truth, pose[None])[0])
        milliseconds = 1e3 * (process_time() - begin) / len(inside)
        right = sum(math.hypot(x, y) <= RIGHT[0] and bool(abs(wrap(theta)) <= RIGHT[1]) for x, y, theta in offs)
        found[name] = {'starts_count': len(inside), 'answered': len(offs) / len(inside),
                       'wrong_count': len(offs) - right, 'ms_start': milliseconds,
                       'claimed_count': sum(answers[k % 2](maps.aces[first:first + 60])[1] is not None
                                            for k, first in enumerate(firsts))}
    return found


def of_grids(maps) -> dict:
    """The same in occupancy grids."""
    with TemporaryDirectory() as folder:
        return {'grid of intel': summary(maps.halves.inside(maps.count, Path(folder)))}


def of_floors(maps) -> dict:
    """Starts on simulated floors, as mapped and changed; `map_m`: mean error of the maps as a whole."""
    errors = {degrees: float(np.mean([known.error for known in floors.values()]))
              for degrees, floors in maps.floors.items()}
    return {f'{name} {degrees}': {**summary(outcomes), 'map_m': errors[degrees]}
            for name, changed in (('floors', False), ('changed', True))
            for degrees, outcomes in maps.inside(changed).items()}


def of_wings(maps) -> dict:
    """Starts on a floor of two wings that are identical but for their ends, and those that come to an end."""
    found, world = {}, floor(0, alike=True)
    to_an_end = (number for number in itertools.count() if comes_to_an_end(route(world, number, OUTSIDE), SEEN))
    numbers = {'wings': list(range(maps.each)), 'ends': list(itertools.islice(to_an_end, maps.each))}
    for degrees, lidar in LIDARS.items():
        known = floor_map(0, lidar, alike=True)
        for name, starts in numbers.items():
            drives = [floor_drive(0, lidar, number, OUTSIDE, alike=True) for number in starts]
            found[f'{name} {degrees}'] = wings_summary([
                followed(known.localizer, scans, known.true_poses(truth), OUTSIDE) for scans, truth in drives])
    return found


def of_carried(maps) -> dict:
    """Robots that are carried from one start on a floor to another."""
    found = {}
    for degrees, floors in maps.floors.items():
        lidar, outcomes, firsts = LIDARS[degrees], [], []
        for seed, known in floors.items():
            for number in range(max(maps.each // 2, 1)):
                first, second = (floor_drive(seed, lidar, number + further, AGAIN) for further in (0, 500))
                scans, truth = kidnapped(*first, *second)
                outcomes.append(followed(known.localizer, scans, known.true_poses(truth), math.inf))
                firsts.append(len(first[0]))
        found[f'kidnapped {degrees}'] = kidnapped_summary(outcomes, firsts, lidar.rate)
    return found


def of_outside(maps) -> dict:
    """Starts that are not in the map."""
    found = {'removed from intel': outside_summary(maps.halves.removed(maps.count)),
             'aces in intel': outside_summary(maps.halves.other_building(maps.aces, maps.count))}
    for degrees, floors in maps.floors.items():
        drives = [(known, floor_drive(seed + 100, LIDARS[degrees], number, OUTSIDE))
                  for seed, known in floors.items() for number in range(maps.each)]
        found[f'another floor {degrees}'] = outside_summary([followed(known.localizer, scans, None, OUTSIDE)
                                                             for known, (scans, _) in drives])
    return found


PARTS = {'intel': of_intel, 'vote': of_vote, 'grids': of_grids, 'floors': of_floors, 'wings': of_wings,
         'carried': of_carried, 'outside': of_outside}
"""Name of a table -> what measures it."""


def measure(args) -> Report:
    """Measure; ``--limit N`` takes at most N starts of each kind."""
    report, maps = Report(), Maps(args.data, args.limit or 100, args.seeds)
    for part in args.only or PARTS:
        rows = PARTS[part](maps)
        report.add_courses(part, rows, bounds={name: BOUNDS.get(name.split()[0], BOUNDS['outside']) for name in rows})
    return report
