"""Signs of life for a log: what a long run is doing, as plain lines."""

import threading
import time
from collections.abc import Callable
from types import TracebackType

from lockstep.workflow.waiting.time_left import TimeLeft

PATIENCE = 5.0
"""Seconds before the first line: a command that answers at once says nothing else."""

INTERVAL = 30.0
"""Seconds between two lines while nothing new is being done."""

PAUSE = 10.0
"""Seconds between two lines in any case: a run of short phases is one thing to a reader of a log."""


class ProgressLines:
    """Write a line when something else is being done, at most every `PAUSE` seconds, or every `INTERVAL`; a forecast at once.

    What follows a colon is a detail. A thread of its own keeps the time: whoever works may say nothing for minutes.

    Args:
        write: takes a line.
        patience, interval, pause: seconds before the first line, between lines, and at least between them.
    """

    def __init__(
        self,
        write: Callable[[str], None],
        *,
        patience: float = PATIENCE,
        interval: float = INTERVAL,
        pause: float = PAUSE,
    ) -> None:
        self._write, self._patience, self._interval, self._pause = write, patience, interval, pause
        self._began = time.monotonic()
        self._wrote = self._began - pause
        self._what, self._part, self._written = "", 0.0, ""
        self._left = TimeLeft()
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._keep_time, name="progress", daemon=True)

    def __enter__(self) -> "ProgressLines":
        """Start to keep the time."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop; no line is written afterwards."""
        self._ended.set()
        self._thread.join()

    def tell(self, what: str, part: float) -> None:
        """Take note of what is being done, and the part of it that is done."""
        with self._lock:
            self._what, self._part = what, part
            self._left.tell(what, part)
            self._say_if_due()

    def _keep_time(self) -> None:
        while not self._ended.wait(self._interval / 30):
            with self._lock:
                self._say_if_due()

    def _say_if_due(self) -> None:
        now, phase = time.monotonic(), self._what.partition(":")[0]
        new = phase != self._written
        forecast = new and "likely" in phase  # at once: it is gone when a first part is done
        due = max(self._wrote + (self._pause if new else self._interval), self._began + self._patience)
        if phase and (forecast or now >= due):
            self._written, self._wrote = phase, now
            done = f", {self._part:.0%} done" if self._part > 0 else ""
            left = self._left.text()
            self._write(f"lockstep: {self._what}{done}, {now - self._began:.0f} s{left and f', {left}'}")
