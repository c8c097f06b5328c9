# SPDX-License-Identifier: Apache-2.0
"""Parameter files: what ROS takes is what the commands take, and the file of defaults is current."""
import math
import re

import pytest
import yaml
from benchmarks.odometry.courses import COURSES

from dbscan_reg_ros import ParameterError
from dbscan_reg_ros.paths import ready_made
from dbscan_reg_ros.robot import parameter_files
from dbscan_reg_ros.robot.parameter_files import (
    DEFAULTS_FILE,
    REFERENCE_FILE,
    describe_limits,
    format_parameters,
    format_reference,
    main,
    read_parameters,
    write_parameters,
)
from dbscan_reg_ros.robot.parameters import NodeParameters


@pytest.fixture
def read(tmp_path):
    """``read(text)``: the parameters in a file with that text."""
    path = tmp_path / 'parameters.yaml'

    def read(text):
        path.write_text(text)
        return read_parameters(path)

    return read


def test_the_document_on_sensors_agrees_with_each_file(root):
    """One row for each file, with the limits and the noise that the file sets or leaves at the default."""
    text = (root / 'doc' / 'sensors.md').read_text()
    table = re.search(r'^\| file \| models .*?\n\n', text, re.DOTALL | re.MULTILINE)[0].strip().splitlines()
    names = re.findall(r'`(scan\.\w+)`', table[0])
    rows = {cells[0].strip(' `'): cells for cells in (line.strip('| ').split('|') for line in table[2:])}
    assert names == [f'scan.{name}' for name in ('range_min', 'range_max', 'noise_min', 'noise_max')]
    assert sorted(rows) == ready_made()
    for name, cells in rows.items():
        values = read_parameters(root / 'config' / f'{name}.yaml').flatten()
        assert [float(cell) for cell in cells[-4:]] == [values[each] for each in names], name
    described = set(re.findall(r'^\| `(\w+)` \|', text, re.MULTILINE))
    assert described == set(rows)


def test_the_file_of_defaults_is_current():
    current = DEFAULTS_FILE.read_text() == format_parameters()
    assert current, 'run python -m dbscan_reg_ros.robot.parameter_files --write'
    assert read_parameters(DEFAULTS_FILE) == NodeParameters()


def test_of_several_files_each_sets_its_parameters_and_a_later_one_wins(tmp_path):
    (tmp_path / 'a.yaml').write_text('/**: {ros__parameters: {scan.range_max: 9.0, base_frame: a}}')
    (tmp_path / 'b.yaml').write_text('/**: {ros__parameters: {base_frame: b}}')
    found = read_parameters(['rplidar_a', tmp_path / 'a.yaml', tmp_path / 'b.yaml'])
    assert found == read_parameters('rplidar_a').replace({'scan.range_max': 9.0, 'base_frame': 'b'})


def test_the_reference_is_current_and_has_a_line_for_every_parameter():
    text = REFERENCE_FILE.read_text()
    assert text == format_reference(), 'run python -m dbscan_reg_ros.robot.parameter_files --write'
    rows = [re.split(r' *\| *', line)[1:-1] for line in text.splitlines() if line.startswith('| `')]
    descriptions = {f'`{d.name}`': d for d in NodeParameters.describe()}
    assert [row[0] for row in rows] == sorted(descriptions,
                                              key=lambda name: ('.' in name, name.startswith('`advanced.')))
    for name, default, limits, *texts in rows:
        d = descriptions[name]
        assert yaml.safe_load(default.strip('`')) == _plain(d.default), name
        assert (limits, *texts) == (describe_limits(d), d.help, *filter(None, [d.case]))


def _plain(value):
    return list(value) if isinstance(value, tuple) else value


def test_one_command_renews_the_defaults_and_the_reference(monkeypatch, tmp_path):
    for name in ('DEFAULTS_FILE', 'REFERENCE_FILE'):
        monkeypatch.setattr(parameter_files, name, tmp_path / name)
    assert main(['--write']) == 0
    assert (tmp_path / 'DEFAULTS_FILE').read_text() == DEFAULTS_FILE.read_text()
    assert (tmp_path / 'REFERENCE_FILE').read_text() == REFERENCE_FILE.read_text()


def test_written_parameters_are_read_back_unchanged(tmp_path):
    changed = NodeParameters().replace({
        'odom_frame': 'yes', 'base_frame': '1e3', 'publish_tf': False, 'laser_pose': [0.1, -1e-7, math.pi],
        'mounting': 'laser_pose', 'scan.range_min': 1e-5, 'scan.range_max': 1 / 3})
    write_parameters(tmp_path / 'changed.yaml', changed)
    assert read_parameters(tmp_path / 'changed.yaml') == changed


def test_the_courses_that_need_an_advanced_parameter_exist():
    cases = [d.case for d in NodeParameters.describe() if d.case]
    named = {name.strip() for case in cases if case.startswith('course')
             for name in case.partition(' ')[2].split(',')}
    assert {'far_noise', 'sparse', 'leader'} <= named <= set(COURSES)


@pytest.mark.parametrize('group, name', [('scan', 'range'), ('scan', 'noise')])
def test_a_least_value_above_the_greatest_is_refused_naming_both(read, group, name):
    text = '/**: {{ros__parameters: {{{0}.{1}_min: 0.4, {0}.{1}_max: {2}}}}}'.format
    with pytest.raises(ParameterError,
                       match=rf'{group}\.{name}_min = 0.4: expected at most {group}\.{name}_max, which is 0.3'):
        read(text(group, name, 0.3))
    assert read(text(group, name, 0.4)).flatten()[f'{group}.{name}_max'] == 0.4


@pytest.mark.parametrize('section', ['/**', '/*', 'scan_matcher', '/scan_matcher', '/robot/scan_matcher',
                                     '/**/scan_matcher'])
def test_sections_for_the_node_count_under_every_name(read, section):
    assert read(f'{section}: {{ros__parameters: {{scan: {{range_max: 5}}}}}}').scan.range_max == 5.0


def test_names_are_nested_or_joined_by_dots_and_later_sections_win(read):
    parameters = read('''
        /**: {ros__parameters: {scan.range_max: 5.0, scan: {range_min: 0.2}, use_sim_time: true}}
        robot: {scan_matcher: {ros__parameters: {scan: {range_max: 6.0}, odom_frame: laser_odom}}}
        other_node: {ros__parameters: {gain: 3.0}}''')
    assert (parameters.scan.range_min, parameters.scan.range_max) == (0.2, 6.0)
    assert parameters.odom_frame == 'laser_odom'


@pytest.mark.parametrize('number', ['1e-3', '1.0e-3', '.001', '1E-3'])
def test_numbers_may_be_written_as_ros_takes_them(read, number):
    assert read(f'/**: {{ros__parameters: {{scan: {{range_min: {number}}}}}}}').scan.range_min == 0.001


@pytest.mark.parametrize('text, complaint', [
    ('/**: {ros__parameters: {scan: {range_mx: 5.0}}}',
     "unknown parameter 'scan.range_mx'; did you mean 'scan.range_max'?"),
    ('/**: {ros__parameters: {advanced: {scan: {range_min: 0.1}}}}', 'advanced.scan.range_min is now scan.range_min'),
    ('/**: {ros__parameters: {density: {max_distance: 0.5}}}',
     'density.max_distance is now advanced.density.max_distance'),
    ('/**: {ros__parameters: {time: {max_jump: 0.5}}}', 'time.max_jump is now advanced.time.max_jump'),
    ('/**: {ros__parameters: {advanced.odometry.prior: none}}', 'advanced.odometry.prior is now prior.source'),
    ('/**: {ros__parameters: {advanced.translation.max_width: 0.1}}',
     'advanced.translation.max_width is gone: clusters of translations are never clustered again'),
    ('/**: {ros__parameters: {advanced: {segments: {join_gap: 0.5}}}}',
     'advanced.segments.join_gap is no parameter any more: it is 1.0 for every sensor, robot and building'),
    ('/**: {ros__parameters: {scan: {range_max: far}}}', "scan.range_max = 'far': expected a number"),
    ('/**: {ros__parameters: {scan: {range_max: -1.0}}}', 'scan.range_max = -1.0: expected 0.0 to 1000.0 m'),
    ('/**: {ros__parameters: {scan: {range_max: .nan}}}', 'scan.range_max = nan: expected a finite number'),
    ('/**: {ros__parameters: {scan: {range_max: [1.0]}}}', 'scan.range_max = [1.0]: expected a number'),
    ('/**: {ros__parameters: {scan: 3}}', "unknown parameter 'scan'"),
    ('/**: {ros__parameters: {laser_pose: [1.0, 2.0]}}', 'laser_pose = [1.0, 2.0]: expected 3 numbers'),
    ('/**: {ros__parameters: {laser_pose: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}}', 'expected 3 numbers'),
    ('/**: {ros__parameters: {input: {time_offset: 0.1}}}', 'input.time_offset = 0.1: expected a list of numbers'),
    ('/**: {ros__parameters: {input: {time_offset: [0.1, 0.2]}}}', 'time_offset = [0.1, 0.2]: expected one number'),
    ('/**: {ros__parameters: {laser_pose: [1, 2, x]}}', "laser_pose[2] = 'x': expected a number"),
    ('/**: {ros__parameters: {mounting: above}}', "mounting = 'above': expected one of 'none', 'laser_pose', 'tf'"),
    ('/**: {ros__parameters: {odom_frame: /odom}}', 'without a leading slash'),
    ('/**: {ros__parameters: {odom_frame: base_link}}', 'expected two different frames'),
    ('/**: {ros__parameters: {prior: {source: tf, frame: odom}}}', "prior.frame = 'odom': expected an odometry frame"),
    ('other_node: {ros__parameters: {gain: 3.0}}', "no parameters for 'scan_matcher', only for /other_node"),
    ('/**: {ros__parameters: [1, 2]}', 'expected names with values'),
    ('scan: {range_max: 5.0}', 'has no section'),
    ('', 'has no section'),
    ('[1, 2]', 'has no section'),
    ('a: b: c', 'line 1: no valid YAML'),
    ('a: !!python/object/apply:os.getcwd []', 'no valid YAML'),
])
def test_a_wrong_file_is_refused_naming_file_and_key(read, tmp_path, text, complaint):
    with pytest.raises(ParameterError) as caught:
        read(text)
    assert complaint in str(caught.value)
    assert str(tmp_path / 'parameters.yaml') in str(caught.value)


def test_a_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='cannot be read: No such file'):
        read_parameters(tmp_path / 'none.yaml')
    (tmp_path / 'binary.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ParameterError, match='no valid YAML: expected a text file in UTF-8'):
        read_parameters(tmp_path / 'binary.yaml')
