# SPDX-License-Identifier: Apache-2.0
"""As much of ``launch`` and ``launch_ros`` as our launch files use.

The same names and keywords, and the same command lines.

The names, keywords, order of arguments and files of parameters are those of Jazzy. What is not here raises a TypeError
or an ImportError.
"""
import sys
import tempfile
from types import ModuleType, SimpleNamespace

import yaml

PROCESS_KEYWORDS = {'additional_env', 'arguments', 'condition', 'cwd', 'emulate_tty', 'env', 'exec_name', 'on_exit',
                    'output',
                    'prefix', 'respawn', 'respawn_delay', 'shell', 'sigkill_timeout', 'sigterm_timeout'}


class LaunchDescription:
    def __init__(self, initial_entities=None, *, deprecated_reason=None):
        self.entities = list(initial_entities or [])


class LaunchContext:
    def __init__(self, configurations):
        self.launch_configurations = dict(configurations)


class Action:
    def execute(self, _context):
        """What is visited next."""
        return []


class DeclareLaunchArgument(Action):
    def __init__(self, name, *, default_value=None, description=None, choices=None, condition=None):
        assert isinstance(name, str) and isinstance(description, str)
        assert default_value is None or isinstance(default_value, str)
        assert choices is None or default_value is None or default_value in choices
        self.name, self.default_value, self.description, self.choices = name, default_value, description, choices

    def execute(self, context):
        given = context.launch_configurations
        if self.name not in given:
            if self.default_value is None:
                raise RuntimeError(f'Required launch argument "{self.name}" was not provided.')
            given[self.name] = self.default_value
        if self.choices is not None and given[self.name] not in self.choices:
            raise RuntimeError(f'Argument "{self.name}" provided value "{given[self.name]}" is not valid. Valid '
                               'options are: '
                               f'{self.choices}')
        return []


class OpaqueFunction(Action):
    def __init__(self, *, function, args=None, kwargs=None, condition=None):
        assert callable(function)
        self._call = lambda context: function(context, *(args or []), **(kwargs or {}))

    def execute(self, context):
        return self._call(context) or []


class EmitEvent(Action):
    def __init__(self, *, event, condition=None):
        self.event = event


class RegisterEventHandler(Action):
    def __init__(self, event_handler, *, condition=None):
        self.event_handler = event_handler


class Shutdown(Action):
    def __init__(self, *, reason='reason not given', condition=None):
        self.reason = reason


def matches_action(target_action):
    return lambda action: action is target_action


class Node(Action):
    # Keywords of launch_ros.
    def __init__(self, *, executable, package=None, name=None, namespace=None,  # noqa: PLR0913
                 exec_name=None, parameters=None, remappings=None, ros_arguments=None, arguments=None, **process):
        assert set(process) <= PROCESS_KEYWORDS, process
        assert parameters is None or isinstance(parameters, list)
        self.executable, self.package, self.name, self.namespace = executable, package, name, namespace
        self.parameters, self.remappings, self.process = parameters or [], remappings or [], process
        self.ros_arguments, self.arguments = ros_arguments, arguments or []

    def command(self):
        """The words after the executable, as the process gets them."""
        namespace = f'/{self.namespace.strip("/")}' if self.namespace is not None else None
        words = list(self.arguments)
        words += [] if self.ros_arguments is None else ['--ros-args', *self.ros_arguments]
        words += ['--ros-args']
        words += [] if self.name is None else ['-r', f'__node:={self.name}']
        words += [] if namespace is None else ['-r', f'__ns:={namespace}']
        full_name = f'{namespace.rstrip("/")}/{self.name}' if self.name and namespace else '/**'
        for layer in self.parameters:
            words += ['--params-file', layer if isinstance(layer, str) else _file(full_name, layer)]
        for source, target in self.remappings:
            words += ['-r', f'{source}:={target}']
        assert all(isinstance(word, str) for word in words), words
        return words


def _file(full_name, values):
    with tempfile.NamedTemporaryFile('w', prefix='launch_params_', suffix='.yaml', delete=False) as file:
        yaml.dump({full_name: {'ros__parameters': values}}, file)
    return file.name


class LifecycleNode(Node):
    def __init__(self, *, name, namespace, autostart=False, **keywords):
        super().__init__(name=name, namespace=namespace, **keywords)


class OnStateTransition:
    def __init__(self, *, entities, target_lifecycle_node=None, transition=None, start_state=None, goal_state=None,
                 matcher=None):
        assert isinstance(target_lifecycle_node, LifecycleNode)
        self.entities, self.node = entities, target_lifecycle_node
        self.start_state, self.goal_state = start_state, goal_state


class ChangeState:
    def __init__(self, *, lifecycle_node_matcher, transition_id):
        assert callable(lifecycle_node_matcher)
        self.lifecycle_node_matcher, self.transition_id = lifecycle_node_matcher, transition_id


MODULES = {
    'launch': {'LaunchDescription': LaunchDescription, 'LaunchContext': LaunchContext},
    'launch.actions': {'DeclareLaunchArgument': DeclareLaunchArgument, 'EmitEvent': EmitEvent,
                       'OpaqueFunction': OpaqueFunction,
                       'RegisterEventHandler': RegisterEventHandler, 'Shutdown': Shutdown},
    'launch.events': {'matches_action': matches_action},
    'launch_ros': {},
    'launch_ros.actions': {'LifecycleNode': LifecycleNode, 'Node': Node},
    'launch_ros.event_handlers': {'OnStateTransition': OnStateTransition},
    'launch_ros.events': {},
    'launch_ros.events.lifecycle': {'ChangeState': ChangeState},
}


def install(monkeypatch):
    """Have ``import launch`` and ``import launch_ros`` find this, and nothing else of that name."""
    for name in [name for name in sys.modules if name.partition('.')[0] in ('launch', 'launch_ros')]:
        monkeypatch.delitem(sys.modules, name)
    for name, contents in MODULES.items():
        module = ModuleType(name)
        vars(module).update(contents)
        module.__path__ = []
        monkeypatch.setitem(sys.modules, name, module)


def visit(description, configurations):
    """What is left to do when the description has been visited with these launch arguments, in its order."""
    context, done, left = LaunchContext(configurations), [], list(description.entities)
    while left:
        action = left.pop(0)
        done.append(action)
        left = [*action.execute(context), *left]
    return [action for action in done if not isinstance(action, (DeclareLaunchArgument, OpaqueFunction))]


def rules(node):
    """What the command line of a node says, by kind.

    Returns
    -------
    SimpleNamespace
        ``own`` words before those of ROS, ``remap`` as pairs, ``files`` of parameters, ``set`` parameters, ``log``.
    """
    words = node.command()
    start = words.index('--ros-args')
    found = SimpleNamespace(own=words[:start], remap=[], files=[], set=[], log=None)
    rest = iter(word for word in words[start:] if word != '--ros-args')
    for flag in rest:
        value = next(rest)
        if flag == '-r':
            found.remap.append(tuple(value.split(':=')))
        elif flag == '-p':
            found.set.append(tuple(value.split(':=')))
        elif flag == '--params-file':
            found.files.append(value)
        else:
            assert flag == '--log-level', flag
            found.log = value
    return found
