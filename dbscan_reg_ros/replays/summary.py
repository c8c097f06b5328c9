"""The measures of a replay, as a file and in words."""
import json

from ..core.records import Status
from ..recordings.files import replacing


def write_metrics(path, recording, measures):
    """Write ``metrics.json``: the recording's name and file, what was assumed to read it, what is odd about its scans, and
    every measure by its name."""
    content = {'recording': recording.name, 'file': str(recording.path), 'topic': recording.topic, 'notes': recording.notes,
               'warnings': [sighting.as_fields() for sighting in recording.watch.sightings], **measures}
    with replacing(path) as file:
        file.write(json.dumps(content, indent=1, allow_nan=False) + '\n')


def summarise(measures) -> list:
    """(what, how much) of what matters most among the measures of a replay."""
    states = ' '.join(f'{status.value} {measures[status.value]}' for status in Status if measures[status.value])
    lines = [('scans', f'{measures["scans"]} lost {measures["lost"]} {states}'.rstrip())]
    if 'ms_p50' in measures:
        lines.append(('time', f'median {measures["ms_p50"]:.2f} ms, p95 {measures["ms_p95"]:.2f} ms per scan'))
    for name, words in (('neighbour', 'neighbours'), ('loop', 'loops'), ('all', 'relations')):
        if f'relations_{name}_mean_m' in measures:
            lines.append((words, f'mean {measures[f"relations_{name}_mean_m"]:.3f} m '
                                 f'{measures[f"relations_{name}_mean_deg"]:.2f} deg'))
    for metres in (1, 5):
        if f'rpe_{metres}m_mean_m' in measures:
            lines.append((f'over {metres} m', f'mean {measures[f"rpe_{metres}m_mean_m"]:.4f} m '
                                              f'{measures[f"rpe_{metres}m_mean_deg"]:.2f} deg, '
                                              f'median {measures[f"rpe_{metres}m_median_m"]:.4f} m'))
    if 'ate_m' in measures:
        lines.append(('position', f'{measures["ate_m"]:.3f} m root mean square after alignment'))
    if 'loops' in measures:
        closed = [f'{measures["loops"]} places seen again']
        if 'closed_relations_all_mean_m' in measures:
            closed.append(f'relations mean {measures["closed_relations_all_mean_m"]:.3f} m '
                          f'{measures["closed_relations_all_mean_deg"]:.2f} deg')
        if 'closed_ate_m' in measures:
            closed.append(f'position {measures["closed_ate_m"]:.3f} m')
        lines.append(('closed', ', '.join(closed)))
    return lines
