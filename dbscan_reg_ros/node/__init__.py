"""The ROS 2 node: turns messages into scans and results into messages, and decides nothing about geometry."""
