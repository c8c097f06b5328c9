# SPDX-License-Identifier: Apache-2.0
"""Warnings that do not flood the log."""
import re
import time

MAX_KINDS = 100


class Notices:
    """Logs a warning at once, and then no more of the same kind for a while.

    Warnings are of the same kind when they differ in nothing but numbers and quoted names.

    Parameters
    ----------
    logger : rclpy logger
    period : float
        Time between two warnings of one kind [s].
    """

    def __init__(self, logger, period=10.0):
        self._logger = logger
        self._period = period
        self._kinds = {}

    def warn(self, text):
        """Log `text`, or count it when its kind was logged a short while ago."""
        kind = re.sub(r"'[^']*'|-?\b(\d[\w.+-]*|nan|inf)\b", '#', text)
        now = time.monotonic()
        last, unsaid = self._kinds.get(kind, (-self._period, 0))
        if now - last < self._period:
            self._kinds[kind] = last, unsaid + 1
            return
        if len(self._kinds) > MAX_KINDS:
            self._kinds.clear()
        self._kinds[kind] = now, 0
        self._logger.warning(text + (f' ({unsaid} more like this since the last time)' if unsaid else ''))
