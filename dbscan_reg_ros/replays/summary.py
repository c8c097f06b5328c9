# SPDX-License-Identifier: Apache-2.0
"""Measures of a replay, written to metrics.json and summarised in words."""
import json
import math

from ..core.registration.records import Status
from ..recordings.files import replacing


def write_metrics(path, recordings, measures, counts, bodies=()):
    """Write ``metrics.json``.

    The file contains name and file of the recording, notes on how the recording was read, warnings about its scans, and
    each of the `measures` of the first lidar by its name; null for one that is not finite. For several lidars, it also
    contains the number of scans of each by outcome: `counts`, topic -> `LidarCounts`. `recordings` have the topic of
    the first lidar, then of each other one. `bodies` are topic, kind and a sentence on what the replay found about
    lidars.
    """
    recording = recordings[0]
    warnings = [{'topic': each.topic} | sighting.as_fields()
                for each in recordings for sighting in each.watch.sightings]
    warnings += [{'topic': topic, 'kind': kind, 'text': text} for topic, kind, text in bodies]
    content = {'recording': recording.name, 'file': str(recording.path), 'topic': recording.topic,
               'notes': _notes(recordings), 'warnings': warnings}
    if counts:
        content['lidars'] = {topic: count.measures() for topic, count in counts.items()}
    content |= {name: value if math.isfinite(value) else None for name, value in measures.items()}
    with replacing(path) as file:
        file.write(json.dumps(content, indent=1, allow_nan=False) + '\n')


def describe_recordings(recordings, counts, bodies=(), base=False) -> list:
    """Return lines about the lidars, assumptions in reading, and warnings about scans, as (name, text) pairs.

    `recordings`, `counts` and `bodies` are those of `write_metrics`; with several lidars each line begins with a topic.
    `base`: whether the files of poses have those of the base.
    """
    lidars = [('lidar', f'{topic}: {count}') for topic, count in counts.items()]
    if lidars:
        lidars.append(('numbers', 'those of scans count the scans of all lidars in the order of their stamps, from 0'))
    if lidars or base:
        of_files = ', in the files *.tum those of the base' if base else ''
        lidars.append(
            ('poses', f'those of the lidar on {recordings[0].topic}, in its frame at its first scan{of_files}'))
    seen = [(each.topic, line) for each in recordings for line in each.watch.lines()]
    return [*lidars, *(('note', note) for note in _notes(recordings)),
            *(('warning', f'{topic}: {line}' if counts else line) for topic, *_, line in (*seen, *bodies))]


def describe_contradictions(trajectory) -> list:
    """Return a line about the scans that contradict the wheels, as (name, text) pairs; none if none does."""
    count, (_, text) = trajectory.contradictions, trajectory.contradicted
    return [('warning', f'{count} scans contradict the wheels, most of all one: {text}')] if count else []


def _notes(recordings):
    """Return the notes on how the recordings were read; with several lidars each begins with a topic."""
    return [f'{each.topic}: {note}' if len(recordings) > 1 else note for each in recordings for note in each.notes]


def summarise(measures) -> list:
    """Return the most important measures of a replay as (name, text) pairs."""
    names = (*(status.value for status in Status), 'restarts')
    counts = [f'{name} {measures[name]}' for name in names if measures[name]]
    lines = [('scans', ' '.join([f'{measures["scans"]} skipped {measures["skipped"]}', *counts]))]
    if 'driven_m' in measures:
        lines.append(('driven', _driven(measures)))
    if 'ms_p50' in measures:
        lines.append(('time', f'median {measures["ms_p50"]:.2f} ms, p95 {measures["ms_p95"]:.2f} ms per scan; '
                              f'processor time {measures["processor_ms_mean"]:.2f} ms per scan'))
    return [*lines, *_errors(measures), *_closed(measures)]


def _errors(measures):
    """Yield the errors of the odometry against relations and truth, as (name, text) pairs."""
    for name, words in (('neighbour', 'neighbours'), ('loop', 'loops'), ('all', 'relations')):
        if f'relations_{name}_mean_m' in measures:
            yield (words, f'mean {measures[f"relations_{name}_mean_m"]:.3f} m '
                    f'{measures[f"relations_{name}_mean_deg"]:.2f} deg')
    for metres in (1, 5):
        if f'rpe_{metres}m_mean_m' in measures:
            yield (f'over {metres} m', f'mean {measures[f"rpe_{metres}m_mean_m"]:.4f} m '
                                              f'{measures[f"rpe_{metres}m_mean_deg"]:.2f} deg, '
                                              f'median {measures[f"rpe_{metres}m_median_m"]:.4f} m')
    if 'ate_m' in measures:
        yield ('position', f'{measures["ate_m"]:.3f} m root mean square after alignment')


def _closed(measures):
    """Yield the errors after loop closing, as (name, text) pairs."""
    if 'loops' in measures:
        closed = [f'{measures["loops"]} places seen again']
        if 'closed_relations_all_mean_m' in measures:
            closed.append(f'relations mean {measures["closed_relations_all_mean_m"]:.3f} m '
                          f'{measures["closed_relations_all_mean_deg"]:.2f} deg')
        if 'closed_ate_m' in measures:
            closed.append(f'position {measures["closed_ate_m"]:.3f} m')
        yield 'closed', ', '.join(closed)


def _driven(measures):
    without = f' (jumps of the stamps left out: {measures["stamp_jumps"]})' if measures['stamp_jumps'] else ''
    return (f'{measures["driven_m"]:.2f} m in {measures["duration_s"]:.1f} s{without}, the end is '
            f'{measures["end_m"]:.3f} m and {measures["end_deg"]:.1f} deg from the start')
