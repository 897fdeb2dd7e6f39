"""Signs of life for a log: what a long run is doing, as plain lines."""

import threading
import time
from collections.abc import Callable
from types import TracebackType

PATIENCE = 5.0
"""Seconds before the first line: a command that answers at once says nothing else."""

INTERVAL = 10.0
"""Seconds between two lines while nothing new is being done."""


class ProgressLines:
    """Write a line when something else is being done, and every `INTERVAL` seconds while it is not.

    A thread of its own keeps the time: whoever works may say nothing for minutes.

    Args:
        write: takes a line.
        patience, interval: seconds before the first line, and between lines.
    """

    def __init__(
        self, write: Callable[[str], None], *, patience: float = PATIENCE, interval: float = INTERVAL
    ) -> None:
        self._write, self._patience, self._interval = write, patience, interval
        self._began = self._wrote = time.monotonic()
        self._what, self._part, self._written = "", 0.0, ""
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
            self._say_if_due()

    def _keep_time(self) -> None:
        while not self._ended.wait(self._interval / 10):
            with self._lock:
                self._say_if_due()

    def _say_if_due(self) -> None:
        now = time.monotonic()
        if not self._what or now - self._began < self._patience:
            return
        if self._what == self._written and now - self._wrote < self._interval:
            return
        self._written, self._wrote = self._what, now
        done = f", {self._part:.0%} done" if self._part > 0 else ""
        self._write(f"lockstep: {self._what}{done}, {now - self._began:.0f} s")
