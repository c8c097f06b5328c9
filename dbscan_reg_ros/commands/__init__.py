# SPDX-License-Identifier: Apache-2.0
"""The commands: one module each, with ``main(argv=None) -> int``."""

COMMANDS = {
    'scan_matcher': ('node.scan_matcher', 'laser odometry as a ROS 2 node'),
    'scan_matcher_lifecycle': ('node.scan_matcher_lifecycle', 'the same as a managed node'),
    'replay': ('commands.replay', 'odometry of recordings, offline, with a report of each'),
    'register': ('commands.register', 'one scan onto another, in numbers and in the figures of the paper'),
    'play': ('commands.play', 'publish a recording to a running node'),
    'demo': ('commands.demo', 'the node on a simulated building or a recording, with its error'),
    'compare': ('commands.compare', 'two parameter sets or methods on the same recordings: is B worse?'),
    'tune': ('commands.tune', 'search the parameters that suit recordings'),
    'simulate': ('commands.simulate', 'a recording of any lidar in a simulated building, with exact truth'),
    'dump': ('commands.dump', 'the parameters of a running node as a file'),
    'convert': ('commands.convert', 'CARMEN logs and ROS 1 and ROS 2 bags into one another'),
}
"""Name -> module in this package, and what it does."""
