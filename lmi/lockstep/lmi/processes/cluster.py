"""The workers of a Dask scheduler, to search with beyond one machine.

A start is a pure function of the search and its number: one that is lost with a worker is done again elsewhere, and is the
same. So a design made on a cluster is the design made here.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from lockstep.check.errors import ClaimError, ProblemError, demand
from lockstep.check.wording import shorten

ADDRESS = r"inproc://.+|(\w+://)?[^/\s]+:\d+"
"""Of a scheduler: a host and a port, with or without a protocol."""

EXPECTED = "the address of a running one, such as tcp://127.0.0.1:8786"

CONNECT_SECONDS = 10


def check_address(scheduler: str | None) -> None:
    """Refuse what Dask would only refuse later, with a traceback of its own.

    Raises:
        ProblemError: it is no address.
    """
    if scheduler is not None and not re.fullmatch(ADDRESS, scheduler):
        raise ProblemError(f"`{shorten(scheduler)}` is no address", where="--scheduler", expected=EXPECTED)


def connected(address: str) -> Any:
    """Return a client of a scheduler.

    Raises:
        ProblemError: dask.distributed is not installed, or nothing answers at the address.
    """
    try:
        from dask.distributed import Client
    except ImportError:
        raise ProblemError(
            "dask.distributed is not installed",
            where="--scheduler",
            remedy='install the extra `campaign`: pip install "lockstep-control[campaign]"',
        ) from None
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ProblemError(
            f"no scheduler answers at `{address}` ({error})",
            where="--scheduler",
            expected=EXPECTED,
            remedy="start one with `dask scheduler`, and workers with `dask worker ADDRESS`",
        ) from None


@contextmanager
def searching_on(scheduler: str | None, time_limit: float | None = None) -> Iterator[None]:
    """Let the starts of searches in the body run on the workers of a scheduler, by joblib's backend; None for here.

    Raises:
        ProblemError: see `connected`; or a time limit, which is of one machine's clock.
        ClaimError: a start was lost with too many workers, or they do not have this package.
    """
    if scheduler is None:
        yield
        return
    check_address(scheduler)
    demand(
        time_limit is None,
        "a time limit is given for a search on a cluster, whose clocks differ",
        where="--scheduler",
        expected="no --time-limit",
        remedy="lower [design] starts instead",
    )
    from joblib import parallel_config

    with connected(scheduler) as client:
        from dask.distributed import CancelledError, KilledWorker

        try:
            with parallel_config(backend="dask", client=client):
                yield
        except (KilledWorker, CancelledError, ImportError) as error:
            raise ClaimError(
                f"the search failed on the cluster: {type(error).__name__}: {error}; the workers need this version of"
                " lockstep, and memory for the search"
            ) from None
