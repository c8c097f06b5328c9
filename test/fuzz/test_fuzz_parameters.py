# SPDX-License-Identifier: Apache-2.0
"""Parameter files with every wrong type and value: a named error, or parameters within their bounds."""
import datetime
import math

import numpy as np
import pytest
import yaml
from child import in_child
from damage import damaged_bytes, damaged_text
from hypothesis import given
from hypothesis import strategies as st

from dbscan_reg_ros import ParameterError
from dbscan_reg_ros.robot.parameter_files import DEFAULTS_FILE, read_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters

DESCRIPTIONS = NodeParameters.describe()
NAMES = st.sampled_from([d.name for d in DESCRIPTIONS])
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.integers(-10, 10), st.sampled_from([2**63, -2**63 - 1, 10**400]),
                    st.floats(),
    st.floats(0.0, 10.0), st.text(max_size=20), st.sampled_from([c for d in DESCRIPTIONS for c in d.choices or ()]),
    st.dates(), st.binary(max_size=5), st.just(datetime.datetime(2000, 1, 1, 12)))
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=9) | st.dictionaries(SCALARS, inner, max_size=3),
                      max_leaves=9)


def check(parameters):
    """Every value has its type and lies within its bounds."""
    values = parameters.flatten()
    for d in DESCRIPTIONS:
        value = values[d.name]
        assert type(value) is d.type
        for part in value if d.type is tuple else (value,):
            assert type(part) is type(d.default[0] if d.type is tuple else d.default)
            if not isinstance(part, str):
                assert math.isfinite(part)
                assert d.minimum is None or part >= d.minimum
                assert d.maximum is None or part <= d.maximum
        assert d.choices is None or value in d.choices


def read(path, content):
    path.write_bytes(content)
    try:
        parameters = read_parameters(path)
    except ParameterError as error:
        assert str(path) in str(error)
        return None
    check(parameters)
    return parameters


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    return tmp_path_factory.mktemp('parameters') / 'parameters.yaml'


@given(st.dictionaries(NAMES, VALUES, min_size=1, max_size=4))
def test_any_value_is_refused_by_name_or_within_its_bounds(path, values):
    read(path, yaml.safe_dump({'/**': {'ros__parameters': values}}, allow_unicode=True).encode())


@given(VALUES)
def test_any_yaml_is_refused_by_name_or_read(path, tree):
    for content in (tree, {'/**': tree}, {'/**': {'ros__parameters': tree}}):
        read(path, yaml.safe_dump(content, allow_unicode=True).encode())


@given(st.text(alphabet='{}[]:,-&*!|>\'"#%@`?~ \n\t0123456789.eE+_abrosp/', max_size=60))
def test_any_text_is_refused_by_name_or_read(path, text):
    read(path, text.encode())


def test_a_damaged_file_of_defaults_is_refused_by_name_or_read(path, size):
    text = DEFAULTS_FILE.read_text()
    for seed in range(size(30, 2000)):
        rng = np.random.default_rng(seed)
        read(path, damaged_text(text, rng).encode() if seed % 2 else damaged_bytes(text.encode(), rng))


HOSTILE = {
    'an alias': '/**: {ros__parameters: {scan: {range_min: &a 1.0, range_max: *a}}}',
    'aliases of aliases': 'a: &a [x, x, x, x]\n' + ''.join(f'{b}: &{b} [*{a}, *{a}, *{a}, *{a}]\n'
                                                         for a, b in zip('abcdefghijklmnop', 'bcdefghijklmnopq',
                                                                         strict=True)),
    'one that holds itself': '/**: &a {ros__parameters: *a}',
    'deep': 2000 * '[' + 2000 * ']',
    'a number of many digits': f'/**: {{ros__parameters: {{scan: {{range_max: {5000 * "9"}}}}}}}',
    'a date that is none': '/**: {ros__parameters: {scan: {range_max: 2000-13-45}}}',
    'long': '#' + 2**20 * ' ',
}


@pytest.mark.parametrize('kind', HOSTILE)
def test_hostile_files_are_refused_in_bounded_memory(path, kind):
    refused, memory = in_child(refusal, path, HOSTILE[kind], timeout=30)
    assert str(path) in refused and len(refused) < 6000
    assert memory < 256 * 2**20


def refusal(path, text):
    path.write_text(text)
    try:
        read_parameters(path)
    except ParameterError as error:
        return str(error)
    return ''


def test_a_device_that_never_ends_is_refused():
    refused, memory = in_child(refused_device, timeout=30)
    assert '/dev/zero: expected a file, and it is a device' in refused
    assert memory < 256 * 2**20


def refused_device():
    try:
        read_parameters('/dev/zero')
    except ParameterError as error:
        return str(error)
    return ''
