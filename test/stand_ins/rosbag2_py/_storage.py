# SPDX-License-Identifier: Apache-2.0
"""Options and metadata of bags, with the signatures of `rosbag2_py` in ROS 2 Jazzy."""
from pathlib import Path

import yaml
from rclpy.duration import Duration
from rclpy.time import Time


class ConverterOptions:
    def __init__(self, input_serialization_format='', output_serialization_format=''):
        self.input_serialization_format = input_serialization_format
        self.output_serialization_format = output_serialization_format


class StorageOptions:
    # Arguments of rosbag2_py.
    def __init__(self, uri, storage_id='', max_bagfile_size=0, max_bagfile_duration=0,  # noqa: PLR0913
                 max_cache_size=0, storage_preset_profile='', storage_config_uri='', snapshot_mode=False,
                 start_time_ns=-1, end_time_ns=-1, custom_data=None):
        assert isinstance(uri, str) and isinstance(storage_id, str)
        self.uri, self.storage_id = uri, storage_id


class StorageFilter:
    def __init__(self, topics=(), topics_regex='', topics_regex_to_exclude=''):
        self.topics = list(topics)


class QoS:
    """The numbers are those of ``rmw_qos_reliability_policy_t`` and ``rmw_qos_durability_policy_t``."""

    def __init__(self, history_depth):
        self.described = {'history': 1, 'depth': history_depth, 'reliability': 1, 'durability': 2}

    def reliable(self):
        return self._with(reliability=1)

    def transient_local(self):
        return self._with(durability=1)

    def _with(self, **policies):
        self.described.update(policies)
        return self


class TopicMetadata:
    def __init__(self, id, name, type, serialization_format, offered_qos_profiles=(), type_description_hash=''):
        self.id, self.name, self.type = id, name, type
        self.serialization_format, self.offered_qos_profiles = serialization_format, list(offered_qos_profiles)


class TopicInformation:
    def __init__(self, topic_metadata, message_count):
        self.topic_metadata, self.message_count = topic_metadata, message_count


class BagMetadata:
    def __init__(self, path):
        try:
            described = yaml.safe_load((Path(path) / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
        except (OSError, yaml.YAMLError, TypeError, KeyError) as error:
            raise RuntimeError(f'Exception on parsing info file: {error}') from error
        self.compression_mode, self.storage_identifier = described['compression_mode'], described['storage_identifier']
        self.files = [Path(path) / name for name in described['relative_file_paths']]
        self.message_count = described['message_count']
        self.starting_time = Time(nanoseconds=described['starting_time']['nanoseconds_since_epoch'])
        self.duration = Duration(nanoseconds=described['duration']['nanoseconds'])
        self.topics_with_message_count = [TopicInformation(_topic(each['topic_metadata']), each['message_count'])
                                          for each in described['topics_with_message_count']]


def _topic(described):
    qualities = []
    for each in described['offered_qos_profiles']:
        qualities.append(QoS(each['depth']))
        qualities[-1].described = each
    return TopicMetadata(0, described['name'], described['type'], described['serialization_format'], qualities)
