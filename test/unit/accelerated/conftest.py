# SPDX-License-Identifier: Apache-2.0
"""The compiled steps, where they are built."""
import numpy as np
import pytest
from accelerated_inputs import assert_same


def pytest_generate_tests(metafunc):
    if 'rng' in metafunc.fixturenames:
        metafunc.parametrize('rng', range(5 if metafunc.config.getoption('--long') else 3), indirect=True)


@pytest.fixture
def rng(request):
    return np.random.default_rng(request.param)


@pytest.fixture
def both(compiled):
    """``both(step, ...)``: assert that both backends give the same, and return it."""
    def both(step, *arguments):
        assert compiled.step(step) is not step
        expected = step(*arguments)
        assert_same(expected, compiled.step(step)(*arguments))
        return expected
    both.compiled = compiled
    return both
