"""How long what is being done may still take, from the part that is done and the time that it took."""

import time
from collections.abc import Callable

SETTLED = 0.05
"""The part that has to be done before anything is said: what a few per cent took says little."""

PATIENCE = 3.0
"""Seconds before anything is said."""


class TimeLeft:
    """The time left of the present phase; one that does not say how far it is has none.

    Args:
        clock: seconds, from any instant.

    >>> now = [0.0]
    >>> left = TimeLeft(lambda: now[0])
    >>> left.tell("searching", 0.0)
    >>> now[0] = 10.0
    >>> left.tell("searching", 0.25)
    >>> left.text()
    'about 30 s left'
    >>> left.tell("proving", 0.0)
    >>> left.text()
    ''
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._what, self._began, self._from, self._part, self._told = "", clock(), 0.0, 0.0, clock()

    def tell(self, what: str, part: float) -> None:
        """Take note of what is being done, and the part of it that is done; what follows a colon is a detail of a phase."""
        now = self._clock()
        phase = what.partition(":")[0]
        if phase != self._what or part < self._part:
            self._what, self._began, self._from = phase, now, part
        self._part, self._told = part, now

    def text(self) -> str:
        """Return the time left as text; nothing where too little is known.

        Between two tellings it counts down, to what a part as long as the last one would leave at least.
        """
        done, now = self._part - self._from, self._clock()
        took = self._told - self._began
        if done < SETTLED or self._part >= 1.0 or now - self._began < PATIENCE:
            return ""
        left = took * (1.0 - self._part) / done - (now - self._told)
        return f"about {seconds_text(left)} left" if left > 0 else "soon"


def seconds_text(seconds: float) -> str:
    """Return a time in one or two digits: it is no more exact than that.

    >>> [seconds_text(one) for one in (0.3, 7.2, 48.0, 130.0, 3000.0, 9000.0)]
    ['1 s', '7 s', '50 s', '2 min', '50 min', '2.5 h']
    """
    if seconds < 10:
        return f"{max(1, round(seconds))} s"
    if seconds < 95:
        return f"{round(seconds / 5) * 5} s"
    if seconds < 5700:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.2g} h"
