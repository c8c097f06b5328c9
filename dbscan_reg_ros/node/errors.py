# SPDX-License-Identifier: Apache-2.0
"""Errors that several parts of the node raise or handle."""


class NoTransformError(LookupError):
    """Two frames are not connected by transforms."""
