"""The commands: one module each, with ``main(argv=None) -> int``."""

COMMANDS = {
    'scan_matcher': ('node.scan_matcher', 'laser odometry as a ROS 2 node'),
    'replay': ('commands.replay', 'odometry of recordings, offline, with a report of each'),
    'play': ('commands.play', 'publish a recording to a running node'),
    'demo': ('commands.demo', 'the node on a simulated building or a recording, with its error'),
    'convert': ('commands.convert', 'CARMEN logs and ROS 1 and ROS 2 bags into one another'),
}
"""Name -> module in this package, and what it does."""
