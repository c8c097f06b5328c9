# SPDX-License-Identifier: Apache-2.0
"""Lidars of a running node, as its parameters describe them."""
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from ...core.errors import ParameterError
from ...core.geometry.mounting import Mounting
from ...core.scan import Scan, in_nanoseconds
from ...robot.mask import corrected_stamp
from ...robot.parameter_groups import InputParameters
from ...robot.parameters import NodeParameters
from ...robot.sensors import sensor_descriptions
from ..frames.mountings import Mountings, Transforms
from ..interfaces.messages import stamp_to_message
from ..interfaces.scan_reader import ScanMessage, ScanReader
from ..throttled_log import ThrottledLog

PLAIN = NodeParameters.describe()


class WatchedLidars:
    """Converts the scans of all lidars of the node with the full name `name` as that node does; our `node` asks it."""

    def __init__(self, node: Node, name: str, transforms: Transforms) -> None:
        self._node, self._namespace = node, name.rpartition('/')[0]
        self._transforms = transforms
        self._client = node.create_client(GetParameters, f'{name}/get_parameters')
        self._parameters: NodeParameters | None = None
        self._known: dict[str, tuple[ScanReader, Mountings, InputParameters]] = {}

    def close(self) -> None:
        """End the requests."""
        self._node.destroy_client(self._client)

    def are_known(self) -> bool:
        """Whether the parameters are known; if not, request them."""
        if self._parameters is None and self._client.service_is_ready():
            self._request([each.name for each in PLAIN], {})
        return self._parameters is not None

    def _request(self, names: list[str], known: dict[str, Any]) -> None:
        future = self._client.call_async(GetParameters.Request(names=names))
        future.add_done_callback(lambda done: self._take(names, known, done))

    def _take(self, names: list[str], known: dict[str, Any], future: Future) -> None:
        """Keep the parameters; first request those of lidars with names."""
        values = [parameter_value_to_python(value) for value in future.result().values]
        known = known | {name: value for name, value in zip(names, values, strict=False) if value is not None}
        own = [name for name in sensor_descriptions(known.get('sensors'), PLAIN) if name not in names]
        if own:
            self._request(own, known)
            return
        try:
            self._parameters = NodeParameters().replace(known)
        except ParameterError:
            # A node of another version: the defaults are assumed.
            self._parameters = NodeParameters()

    def read(self, topic: str, message: ScanMessage) -> tuple[Scan, Mounting]:
        """Convert a message on a `topic`, with the stamp that the node gives it; as `ScanReader.read`, with its errors.

        The parameters must be known.
        """
        assert self._parameters is not None
        reader, mountings, given = self._lidar(topic, self._parameters)
        stamp = corrected_stamp(in_nanoseconds(message.header.stamp), given.time_offset[0])
        message.header.stamp = stamp_to_message(stamp)
        return reader.read(message, mountings, given)

    def _lidar(self, topic: str, parameters: NodeParameters) -> tuple[ScanReader, Mountings, InputParameters]:
        """Return what reads the scans on a `topic`; where it was remapped, those of the first lidar."""
        if topic not in self._known:
            own = next((name for name in parameters.scan_topics if self._full(name) == topic), '')
            lidar, log = parameters.lidar(own), ThrottledLog(self._node.get_logger(), f'{topic}: ')
            self._known[topic] = (ScanReader(self._node.get_clock(), log),
                                  Mountings(parameters.base_frame, lidar, self._transforms), lidar.input)
        return self._known[topic]

    def _full(self, topic: str) -> str:
        """Full name of a topic of the other node."""
        return topic if topic.startswith('/') else f'{self._namespace}/{topic}'
