# SPDX-License-Identifier: Apache-2.0
"""The environment chooses the reference of the registration."""

import pytest

from dbscan_reg_ros import backend_choice


@pytest.fixture
def fresh_choice(monkeypatch):
    """Choose again during the test."""
    for chosen in (backend_choice.choose, backend_choice.compiled_backend):
        chosen.cache_clear()
    yield monkeypatch
    for chosen in (backend_choice.choose, backend_choice.compiled_backend):
        chosen.cache_clear()


@pytest.mark.parametrize(('value', 'name'), [('1', 'reference'), ('0', 'compiled'),
                                              ('', 'compiled')])
def test_the_environment_chooses_the_reference(fresh_choice, value, name):
    fresh_choice.setenv(backend_choice.PURE, value)
    assert backend_choice.choose().name == name

