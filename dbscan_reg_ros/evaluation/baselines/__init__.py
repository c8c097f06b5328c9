# SPDX-License-Identifier: Apache-2.0
"""Small classic registrations that the method is compared with (Table 1 of the paper).

Every module is one of them behind the same interface: ``prepare(scan)`` computes what is kept of a scan, and
``align(reference, current, guess=SE2())`` a `Result` from two of those.
"""
from . import icl, icp, idc
from .result import Result

__all__ = ['Result', 'icl', 'icp', 'idc']
