# SPDX-License-Identifier: Apache-2.0
"""From a scan to its features: range noise, ring band filter, segments, normals, likelihood field, free space."""
from importlib.util import find_spec

from ..errors import BuildError

if find_spec(f'{__package__}.noise') is None:
    raise BuildError('the compiled modules of dbscan_reg_ros are not built; in its folder: python setup.py build_ext '
                     '--inplace, or install a wheel')
