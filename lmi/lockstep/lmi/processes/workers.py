"""Processes to search with that leave an interrupt to the process that started them.

Ctrl-C in a terminal goes to all of them at once, and so does the SIGTERM of `timeout` and of cluster schedulers. One that
is just importing would answer Ctrl-C with a traceback of its own, although whoever asked for it ends it anyway; SIGTERM would
end it, and what was found with it. A child keeps the mask of signals of the thread that starts it, so it is started while
they are blocked there. Another thread may still take an interrupt, and an exception in the middle of the start would leave a
child without its orders: so it is put off until they are started, and none is lost.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

SHIELDED = frozenset({signal.SIGINT, signal.SIGTERM})


@contextmanager
def started_without_interrupts() -> Iterator[None]:
    """Start processes in the body that are never interrupted from the keyboard, nor by SIGTERM.

    >>> with started_without_interrupts():
    ...     signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())
    True
    """
    if not hasattr(signal, "pthread_sigmask"):  # there is none on Windows
        yield
        return
    # Python's own tracker of shared memory unblocks the signal when it starts, so it starts before.
    resource_tracker.ensure_running()
    with _put_off():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SHIELDED)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _put_off() -> Iterator[None]:
    """Deliver an interrupt that comes in the body after it; only the main thread can be interrupted at all."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = False

    def note(_number: int, _frame: object) -> None:
        nonlocal came
        came = True

    before = signal.getsignal(signal.SIGINT)
    if not callable(before):  # ignored, or not Python's to handle: it stays so
        yield
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)
