# SPDX-License-Identifier: Apache-2.0
"""Throttled log: a recurring warning is logged at most once a period."""
from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

MAX_KINDS = 100


class ThrottledLog:
    """Logs a warning at once, then suppresses warnings of the same kind for a `period` [s].

    Two warnings are of the same kind when they differ only in numbers and quoted names, or in how many they list. Each
    begins with `subject`, which names what the warnings are about, and may be changed.
    """

    def __init__(self, logger: RcutilsLogger, subject: str = '', period: float = 10.0) -> None:
        self._logger = logger
        self.subject = subject
        self._period = period
        self._kinds: dict[str, tuple[float, int]] = {}

    def warn(self, text: str) -> None:
        """Log `text`; if a warning of its kind was logged less than a period ago, only count it."""
        kind = re.sub(r'#(, #)+', '#', re.sub(r"'[^']*'|-?\b(\d[\w.+-]*|nan|inf)\b", '#', text))
        now = time.monotonic()
        last, suppressed = self._kinds.get(kind, (-self._period, 0))
        if now - last < self._period:
            self._kinds[kind] = last, suppressed + 1
            return
        if len(self._kinds) > MAX_KINDS:
            self._kinds.clear()
        self._kinds[kind] = now, 0
        more = f' ({suppressed} more like this since the last time)' if suppressed else ''
        self._logger.warning(self.subject + text + more)
