"""What the method is set against: small classic registrations behind one interface.

Every method is a pair of functions: ``prepare(scan)`` computes once what is kept of a scan, and
``align(reference, current)`` returns a record with the ``transform`` that carries points of the current scan
into the reference's frame (Eq. 8) and a ``status``.
"""
from .result import Result

__all__ = ['Result']
