# SPDX-License-Identifier: Apache-2.0
"""Small classic registration methods for comparison (Table 1 of the paper).

Every module has one method with the same interface: ``prepare(scan)`` makes the data of a scan that the method needs,
and ``align(reference, current, guess=SE2())`` returns a `Result` from the data of two scans.
"""
from . import icl, icp, idc
from .result import Result, fit

__all__ = ['Result', 'fit', 'icl', 'icp', 'idc']
