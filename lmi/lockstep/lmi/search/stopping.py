"""When a search is to end early: a limit of time, or a word from whoever waits for it; the best so far is then kept."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Deadline:
    """The end of a search; what it cuts depends on the machine.

    at: of `time.monotonic`, which all processes of a machine share, or None;  flag: a file that ends the search once it is
    there, or nothing: it can be made while the processes run.

    >>> Deadline().over, Deadline(at=0.0).over, Deadline(flag=tempfile.gettempdir()).over
    (False, True, True)
    """

    at: float | None = None
    flag: str = ""

    @classmethod
    def after(cls, seconds: float | None, flag: str = "") -> "Deadline":
        """Return one so many seconds from now, or none."""
        return cls(None if seconds is None else time.monotonic() + seconds, flag)

    @property
    def over(self) -> bool:
        """Whether the search is to end."""
        return (self.at is not None and time.monotonic() >= self.at) or (
            bool(self.flag) and os.path.exists(self.flag)
        )


NEVER = Deadline()


class Stopped(KeyboardInterrupt):
    """Raised in what is not needed for a design that is there already."""


class NothingYet(KeyboardInterrupt):
    """Raised where a search is ended before any gains were certified."""


class Stop:
    """How to end a design early and keep what it has: `take` in a handler of an interrupt.

    Args:
        flag: the file that tells the processes that search.

    Attributes:
        asked: whether an interrupt was taken.
        found: whether gains are there: an interrupt is then taken whatever is being done, and what proves them goes on.

    >>> stop = Stop()
    >>> stop.take(), stop.asked
    (False, False)
    >>> stop.optional(lambda: 1, otherwise=0)
    1
    """

    def __init__(self, flag: Path | None = None) -> None:
        self.flag = "" if flag is None else str(flag)
        self.asked = self.found = False
        self._during = ""

    @classmethod
    @contextmanager
    def ready(cls) -> Iterator["Stop"]:
        """Return one whose file is removed in the end."""
        with tempfile.TemporaryDirectory(prefix="lockstep-stop-") as folder:
            yield cls(Path(folder) / "stop")

    def take(self) -> bool:
        """Take an interrupt; return whether it is taken, and nothing else is to come of it.

        Raises:
            Stopped: what is being done is not needed for the design.
        """
        if self.asked or not (self._during or self.found):
            return False
        self.asked = True
        if self.flag:
            Path(self.flag).touch()
        if self._during == "optional":
            raise Stopped
        return True

    @contextmanager
    def searching(self) -> Iterator[None]:
        """Let an interrupt of the body end the search, which returns the best so far."""
        with self._in("search"):
            yield

    def optional(self, work: Callable[[], T], otherwise: T) -> T:
        """Return what the work does, or something else where an interrupt came before or during it."""
        if self.asked:
            return otherwise
        try:
            with self._in("optional"):
                return work()
        except Stopped:
            return otherwise

    @contextmanager
    def _in(self, phase: str) -> Iterator[None]:
        self._during = phase
        try:
            yield
        finally:
            self._during = ""
