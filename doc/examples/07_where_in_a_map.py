# SPDX-License-Identifier: Apache-2.0
"""Where in a map a recording was made: python 07_where_in_a_map.py MAP RECORDING, with a map of replay --map-out."""
import sys

from dbscan_reg_ros import Localizer, Map, Odometry, open_recording

try:
    file, recording = sys.argv[1:]
except ValueError:
    sys.exit(__doc__)
odometry, localizer, state = Odometry(), Localizer(Map.load(file)), None
for scan in open_recording(recording).scans():
    found = localizer.process(odometry.process(scan))
    if found.state is not state:
        state = found.state
        print(found)
