# SPDX-License-Identifier: Apache-2.0
"""``timed_node.py FILE [ARGUMENTS]``: scan_matcher that writes the time of each of its scans to FILE, if not /dev/null.

A script of its own: it runs with the package of this source tree or with that of another commit.
"""
import functools
import json
import os
import sys
import time

from dbscan_reg_ros.node.scan_matcher import main


def timed(function, milliseconds):
    """Return `function` that appends its processor time in this thread [ms] to a list."""
    @functools.wraps(function)
    def call(*args):
        began = time.thread_time()
        try:
            return function(*args)
        finally:
            milliseconds.append(1e3 * (time.thread_time() - began))
    return call


def run(file, argv) -> int:
    """Run the node; write the lists ``callback``, all that it does with a scan, and ``odometry``, of the core in it."""
    from dbscan_reg_ros.core.odometry.pipeline import Odometry
    from dbscan_reg_ros.node.interfaces.scan_input import ScanTopic
    times = {'callback': [], 'odometry': []}
    ScanTopic._on_message = timed(ScanTopic._on_message, times['callback'])
    Odometry.process = timed(Odometry.process, times['odometry'])
    try:
        return main(argv)
    finally:
        with open(file, 'w', encoding='utf-8') as output:
            json.dump(times, output)


if __name__ == '__main__':
    given, words = sys.argv[1], sys.argv[2:]
    sys.exit(main(words) if given == os.devnull else run(given, words))
