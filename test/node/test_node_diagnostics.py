# SPDX-License-Identifier: Apache-2.0
"""/diagnostics, which the node publishes once a second: what it finds in the ROS graph."""
import rclpy.qos
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros_helpers import diagnosis, said
from sensor_msgs.msg import Image, LaserScan

from dbscan_reg_ros.node.interfaces.messages import scan_to_message


def test_where_no_scan_comes_the_cause_is_named(start_node, peer, scans):
    """No publisher, one on another topic, one of another type, one whose quality of service is incompatible."""
    node = start_node('-r', '__ns:=/robot', '-p', 'qos_overrides./robot/scan.subscription.reliability:=reliable')
    received = peer.listen(DiagnosticArray, '/diagnostics')

    def reported(text):
        return diagnosis(peer, received, lambda s: s.level == DiagnosticStatus.STALE and text in s.message)

    status = reported('no scans on /robot/scan: no node publishes there')
    assert status.name == '/robot/scan_matcher: laser odometry'
    peer.node.create_publisher(LaserScan, '/robot/front/scan', 10)
    reported('start the node with -r scan:=/robot/front/scan')
    image = peer.node.create_publisher(Image, '/robot/scan', 10)
    wrong = '/peer publishes sensor_msgs/msg/Image on /robot/scan; expected sensor_msgs/msg/LaserScan'
    reported(wrong)
    said(node, wrong, peer)
    peer.node.destroy_publisher(image)
    good = peer.node.create_publisher(LaserScan, '/robot/scan', 10)
    reported('/peer publishes there, but no scan is received')
    peer.node.destroy_publisher(good)
    unreliable = peer.node.create_publisher(LaserScan, '/robot/scan', rclpy.qos.qos_profile_sensor_data)
    wrong = 'the quality of service of /peer on /robot/scan is incompatible with ours'
    assert ('its reliability is best effort, ours reliable; let it publish with ours, or start this node with '
            'qos_overrides./robot/scan.subscription.reliability:=best_effort') in reported(wrong).message
    unreliable.publish(scan_to_message(scans[0]))
    said(node, wrong, peer)
