"""One thread of linear algebra: sums then have one order, whatever process they are in and however many cores it has.

A limit holds for the libraries that are loaded when it is set: whatever a design uses is therefore loaded first.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np


@contextmanager
def one_thread() -> Iterator[None]:
    """Run the body with one thread in every BLAS that a design uses; NumPy is silent of numbers that overflow in a search.

    >>> with one_thread():
    ...     sorted({library["num_threads"] for library in threads()})
    [1]
    """
    from threadpoolctl import threadpool_limits

    _load()
    with threadpool_limits(1), np.errstate(all="ignore"):
        yield


def threads() -> list[dict[str, object]]:
    """Return what is known of each library of threads that is loaded: its file and how many threads it would use."""
    from threadpoolctl import threadpool_info

    _load()
    return list(threadpool_info())


@cache
def _load() -> None:
    """Load SciPy's BLAS, which Clarabel uses too, and NumPy's."""
    import cvxpy  # noqa: F401
    import scipy.linalg  # noqa: F401
