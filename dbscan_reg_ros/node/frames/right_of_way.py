# SPDX-License-Identifier: Apache-2.0
"""Arbitration between several senders of one transform: at most one sends at a time."""
from collections.abc import Callable
from enum import Enum

WAIT = 5.0
"""Silence [s] after which another sender of the transform counts as stopped; it doubles with each conflict."""
LONGEST = 80.0
"""Upper limit [s] of the silence that doubles with each conflict; it is `WAIT` again after this time without a
conflict."""
LISTEN = 0.5
"""Time [s] to listen for other senders before sending; each sender with precedence adds the same time."""
DISCOVERY = 0.2
"""Time [s] until other nodes have discovered a publisher that was destroyed and created again."""


class State(Enum):
    """State of our transform sender."""

    LISTENING = 'listening'
    SENDING = 'sending'
    WAITING = 'waiting'


class RightOfWay:
    """Decides when our transform is sent: only while no other node sends a transform to the same child frame.

    All times [s] are read from the same steady clock.

    Attributes
    ----------
    state : State
        LISTENING: our publisher exists, but does not send yet. SENDING: our publisher sends. WAITING: another node
        sends, and our publisher is destroyed.
    wait : float
        Time [s] for which the other sender must be silent before our transform is sent again; 0 before the first
        conflict.
    """

    def __init__(self) -> None:
        self.state = State.LISTENING
        self.wait = 0.0
        self._since: float | None = None
        self._ready = 0.0
        self._last_conflict = 0.0

    @property
    def gives_way(self) -> bool:
        """Whether our transform is not sent because another node sends one."""
        return self.state is State.WAITING

    def conflict(self, now: float) -> None:
        """Stop sending our transform: a transform of another sender was received."""
        self._last_conflict = now
        if self.gives_way:
            return
        undisturbed = self.state is State.SENDING and self._since is not None and now - self._since >= LONGEST
        self.wait = WAIT if undisturbed or not self.wait else min(2.0 * self.wait, LONGEST)
        self.state = State.WAITING

    def take_over(self, now: float) -> bool:
        """Start listening if the other sender has been silent for `wait`; return whether listening was started."""
        if not self.gives_way or now - self._last_conflict < self.wait:
            return False
        self.state, self._since, self._ready = State.LISTENING, None, now + DISCOVERY
        return True

    def may_send(self, now: float, candidates_before: Callable[[], int | None]) -> bool:
        """Whether to send a transform now.

        Parameters
        ----------
        now : float
            Time of the steady clock [s].
        candidates_before : callable
            Function that returns the number of other possible senders with precedence; None if there are no other
            possible senders.
        """
        if self.state is State.LISTENING and self._has_listened(now, candidates_before()):
            self.state, self._since = State.SENDING, now
        return self.state is State.SENDING

    def _has_listened(self, now: float, candidates_before: int | None) -> bool:
        if self._since is None:
            self._since = now
        if now < self._ready:
            return False
        return candidates_before is None or now - self._since >= LISTEN * (1 + candidates_before)

    def insist(self, now: float) -> None:
        """Send our transform from now on, even if another node sends one."""
        self.state, self.wait, self._since = State.SENDING, 0.0, now
