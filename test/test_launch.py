"""The launch files: what they say agrees with the package; they are loaded where launch is installed."""
import ast
import importlib.util

import pytest

from dbscan_reg_ros.commands import COMMANDS

ARGUMENTS = {'namespace': '', 'params_file': 'scan_matcher.yaml', 'use_sim_time': 'false'}


def calls(root, name):
    tree = ast.parse((root / 'launch' / 'scan_matcher.launch.py').read_text())
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == name]


def test_the_arguments_are_declared_and_all_of_them_used(root):
    assert {call.args[0].value for call in calls(root, 'DeclareLaunchArgument')} == set(ARGUMENTS)
    assert {call.args[0].value for call in calls(root, 'LaunchConfiguration')} == set(ARGUMENTS)


def test_the_node_started_is_one_of_the_package(root):
    [node] = calls(root, 'Node')
    words = {k.arg: k.value.value for k in node.keywords if isinstance(k.value, ast.Constant)}
    assert words['package'] == 'dbscan_reg_ros'
    assert words['executable'] in COMMANDS
    assert words['name'] == 'scan_matcher'


def test_the_launch_description_is_made(root, monkeypatch):
    pytest.importorskip('launch_ros', reason='needs launch_ros, part of a ROS installation')
    import ament_index_python.packages
    monkeypatch.setattr(ament_index_python.packages, 'get_package_share_directory', lambda _: str(root))
    spec = importlib.util.spec_from_file_location('description', root / 'launch' / 'scan_matcher.launch.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    declared = {a.name: a for a in module.generate_launch_description().get_launch_arguments()}
    assert set(declared) == set(ARGUMENTS)
    for name, default in ARGUMENTS.items():
        assert declared[name].default_value[0].text.endswith(default)
