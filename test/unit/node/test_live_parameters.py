# SPDX-License-Identifier: Apache-2.0
"""What ROS is told of the parameters."""
import rclpy  # noqa: F401 - needs ROS

from dbscan_reg_ros.node.interfaces.live_parameters import describe
from dbscan_reg_ros.robot.parameters import NodeParameters


def test_each_descriptor_has_help_unit_and_bounds():
    for description in NodeParameters.describe():
        descriptor = describe(description)
        assert descriptor.description.startswith(description.help) and description.unit in descriptor.description
        assert descriptor.read_only == description.read_only
        ranges = {float: descriptor.floating_point_range, int: descriptor.integer_range}.get(description.type, [])
        for bound, name in (description.minimum, 'from_value'), (description.maximum, 'to_value'):
            if description.type in (float, int) and bound is not None:
                assert getattr(ranges[0], name) == bound
        for choice in description.choices or ():
            assert repr(choice) in descriptor.additional_constraints
