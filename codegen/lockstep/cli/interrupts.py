"""An interrupt from the keyboard that is not lost on the way.

Where it comes while CasADi turns arrays into its own, the exception is dropped there, or turned into another. So it is
raised elsewhere if it can be, and once more as long as nothing has come of it.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lockstep.lmi.search.stopping import Stop

AGAIN = 0.05
"""Seconds after which it is looked whether anything has come of the interrupt."""

PATIENCE = 20
"""So often it is put off for the sake of CasADi's conversions, which take microseconds; its solvers take longer."""

DEAF = "casadi"
"""The package whose Python functions are called back from C that drops what they raise."""


@contextmanager
def insistent_interrupts() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the body upon an interrupt, until it is being handled.

    Interrupts stay as they are in a thread other than the main one, where there are no timers, and where somebody has
    decided about them already: a shell that starts a command in the background has them ignored.
    """
    ours = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    patience = PATIENCE

    def once_more(_number: int, frame: FrameType | None) -> None:
        nonlocal patience
        if _is_handled():
            return
        patience -= 1
        if patience < 0 or not _in_deaf_code(frame):
            raise KeyboardInterrupt

    def first(number: int, frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        if _is_handled():  # a second one is meant for whatever the first one waits for
            raise KeyboardInterrupt
        once_more(number, frame)

    before = signal.signal(signal.SIGINT, first), signal.signal(signal.SIGALRM, once_more)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGALRM, before[1])


@contextmanager
def keeping_the_best(say: Callable[[str], None]) -> Iterator["Stop"]:
    """Let an interrupt of a search, or of the proof of its gains, end it with the best so far; a second one is as ever.

    SIGTERM does, too, which `timeout` and cluster schedulers send, however often: `timeout` sends it to the command and then
    to its group, so that the command has it twice.
    """
    from lockstep.lmi.search.stopping import Stop

    with Stop.ready() as stop:
        before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
        main = threading.current_thread() is threading.main_thread()
        heard = [one for one, handler in before.items() if main and handler is not signal.SIG_IGN]

        def take(number: int, frame: FrameType | None) -> None:
            if stop.take():
                say("ending the search; the best gains so far are proved and kept, if any (Ctrl-C again: no)")
            elif stop.asked and number == signal.SIGTERM:
                pass
            elif callable(handler := before[signal.Signals(number)]):
                handler(number, frame)
            else:
                raise KeyboardInterrupt

        for one in heard:
            signal.signal(one, take)
        try:
            yield stop
        finally:
            for one in heard:
                signal.signal(one, before[one])


def _is_handled() -> bool:
    """Tell whether the code that is running runs because of an interrupt."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _in_deaf_code(frame: FrameType | None) -> bool:
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] == DEAF:
            return True
        frame = frame.f_back
    return False
