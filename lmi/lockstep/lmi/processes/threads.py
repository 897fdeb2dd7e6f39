"""One thread of linear algebra: sums then have one order, whatever process they are in and however many cores it has.

A limit holds for the libraries that are loaded when it is set: whatever a design uses is therefore loaded first.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


@contextmanager
def one_thread() -> Iterator[None]:
    """Run the body with one thread in every BLAS that a design uses; NumPy is silent of numbers that overflow in a search.

    >>> from threadpoolctl import threadpool_info
    >>> with one_thread():
    ...     sorted({library["num_threads"] for library in threadpool_info()})
    [1]
    """
    # SciPy's BLAS, which Clarabel uses too, and NumPy's.
    import cvxpy  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1), np.errstate(all="ignore"):
        yield
