# SPDX-License-Identifier: Apache-2.0
"""When to send what others may send, too: nobody may hear two of them."""
from enum import Enum

WAIT = 5.0
"""Another sender on a topic that is silent for so long [s] has gone; twice as long each time."""
LONGEST = 80.0
"""No silence need be longer [s]; who has sent undisturbed for so long starts with `WAIT` again."""
LISTEN = 0.5
"""Who may not be alone listens for so long [s] before it sends, and once more for each that goes first: longer than from one
scan to the next."""
DISCOVERY = 0.2
"""Who has come back is known to the others after this time [s]."""


class State(Enum):
    """What the sender does."""

    LISTENING = 'listening'
    SENDING = 'sending'
    WAITING = 'waiting'


class RightOfWay:
    """Gives way to every other sender, and takes over when that has gone.

    All times are those of one steady clock [s].

    Attributes
    ----------
    state : State
        LISTENING: announced, and about to send. SENDING. WAITING: withdrawn, for somebody else sends.
    wait : float
        So long the other has to be silent, this time or the last time; 0 before the first time.
    """

    def __init__(self):
        self.state = State.LISTENING
        self.wait = 0.0
        self._since = None
        self._ready = 0.0
        self._heard = 0.0

    @property
    def gives_way(self) -> bool:
        """Whether somebody else sends."""
        return self.state is State.WAITING

    def hear(self, now):
        """Somebody else was heard."""
        self._heard = now
        if self.gives_way:
            return
        undisturbed = self.state is State.SENDING and now - self._since >= LONGEST
        self.wait = WAIT if undisturbed or not self.wait else min(2.0 * self.wait, LONGEST)
        self.state = State.WAITING

    def take_over(self, now) -> bool:
        """Whether the other has been silent for long enough now: then it is ours again."""
        if not self.gives_way or now - self._heard < self.wait:
            return False
        self.state, self._since, self._ready = State.LISTENING, None, now + DISCOVERY
        return True

    def may_send(self, now, first) -> bool:
        """Whether to send something that is there to be sent.

        Parameters
        ----------
        now : float
        first : callable
            How many others go first; None when nobody else may send.
        """
        if self.state is State.LISTENING and self._has_listened(now, first()):
            self.state, self._since = State.SENDING, now
        return self.state is State.SENDING

    def _has_listened(self, now, first):
        if self._since is None:
            self._since = now
        if now < self._ready:
            return False
        return first is None or now - self._since >= LISTEN * (1 + first)

    def insist(self, now):
        """Send at once, whoever else does."""
        self.state, self.wait, self._since = State.SENDING, 0.0, now
