# SPDX-License-Identifier: Apache-2.0
"""Inputs that a fuzzer makes to reach every branch: ``coverage_guided.py TARGET RUNS SEED FOLDER`` (needs atheris).

It starts from the inputs in the folder and adds those that reach something new. It ends with status 0 after so many
inputs, or with the traceback of what went wrong and the input in a file ``crash-*``.
"""
import struct
import sys
import tempfile
import warnings
from pathlib import Path
from types import SimpleNamespace

import atheris

with atheris.instrument_imports(include=['dbscan_reg_ros']):
    from dbscan_reg_ros import Odometry, ParameterError, RecordingError, Scan, ScanError
    from dbscan_reg_ros.recordings import open_recording
    from dbscan_reg_ros.robot.parameter_files import read_parameters

FOLDER = Path(tempfile.mkdtemp())


def scan(content):
    """Bytes as the fields of a LaserScan that follows another one."""
    head = content[:36].ljust(36, b'\0')
    sec, nanosec, *numbers = struct.unpack('<iI7f', head)
    names = 'angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min', 'range_max'
    body = content[36:len(content) - len(content) % 4]
    message = SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=''),
                              ranges=[value for value, in struct.iter_unpack('<f', body)],
                              **dict(zip(names, numbers, strict=True)))
    odometry = Odometry()
    for _ in range(2):
        try:
            odometry.process(Scan.from_message(message))
        except ScanError:
            return


def recording(ending):
    def read(content):
        path = FOLDER / f'a{ending}'
        path.write_bytes(content)
        try:
            found = open_recording(path)
            list(found.records())
            found.truth()
        except RecordingError:
            return
    return read


def parameters(content):
    path = FOLDER / 'a.yaml'
    path.write_bytes(content)
    try:
        read_parameters(path)
    except ParameterError:
        return


TARGETS = {'scan': scan, 'log': recording('.log'), 'bag': recording('.bag'), 'mcap': recording('.mcap'),
           'db3': recording('.db3'),
           'parameters': parameters}


def main():
    target, runs, seed, folder = sys.argv[1:]
    warnings.simplefilter('error')
    atheris.Setup([sys.argv[0], f'-runs={runs}', f'-seed={seed}', '-max_len=65536', '-timeout=20', '-rss_limit_mb=512',
                   folder], TARGETS[target])
    atheris.Fuzz()


if __name__ == '__main__':
    main()
