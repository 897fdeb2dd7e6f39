"""How long a search is likely to take, as a range, from its sizes and from how fast this machine is right now.

What a search does most is evaluate the response of the loop; that is timed here for some hundredths of a second. How often
it is needed differs from problem to problem: the range is what it was on problems of many fields, and no more than that.
"""

import os
import time
from collections.abc import Callable

import numpy as np

from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.search.random_start import GainSearch

FEWEST, MOST = 2000, 15_000
"""Times a response of the loop at `RESPONSES` frequencies for each start that is pursued: from 2 150 to 13 200 were measured,
in seconds of processor with four starts, on 18 problems with 6 to 17 states in the loop and 5 to 36 signals."""

FEWEST_OF_LARGE, MOST_OF_LARGE = 600, 6000
"""The same where P is eliminated: from 900 to 4 000 were measured on three problems of 10 and 20 agents."""

RESPONSES = 60

TRIAL = 0.02
"""Seconds for which it is timed."""


def estimated_time(search: GainSearch, starts: int, jobs: int | None = None) -> str:
    """Return how long a search is likely to take, as text.

    Args:
        search: its loop.
        starts: how many are pursued to the end.
        jobs: processes; by default as many as there are cores to run on.
    """
    low, high = range_of_seconds(search, starts, jobs)
    return f"{one_digit(low)} to {one_digit(high)}"


def range_of_seconds(search: GainSearch, starts: int, jobs: int | None = None) -> tuple[float, float]:
    """Return the range in seconds."""
    rounds = -(-starts // (jobs or len(os.sched_getaffinity(0))))
    K, w = np.zeros(search.norm.shape), np.ones(len(search.norm.W))
    # Without their ends, which are numbers that a file may name: at an undamped mode of 10 rad/s there is no response.
    frequencies = np.geomspace(0.1, 10, RESPONSES + 2)[1:-1]
    unit = mean_seconds(lambda: search.norm.worst(K, w, frequencies))
    fewest, most = (FEWEST_OF_LARGE, MOST_OF_LARGE) if eliminates_P(search.loop) else (FEWEST, MOST)
    return fewest * unit * rounds, most * unit * rounds


def mean_seconds(work: Callable[[], object]) -> float:
    """Return the seconds that something takes, the mean over some of it."""
    began, count = time.monotonic(), 0
    while time.monotonic() < began + TRIAL or not count:
        work()
        count += 1
    return (time.monotonic() - began) / count


def one_digit(value: float) -> str:
    """Return a time in one digit, as is said.

    >>> [one_digit(one) for one in (0.4, 7.3, 43.0, 400.0, 8000.0)]
    ['1 s', '7 s', '40 s', '7 min', '2 h']
    """
    for size, name in ((3600.0, "h"), (60.0, "min")):
        if value >= 1.5 * size:
            return f"{float(f'{value / size:.1g}'):g} {name}"
    return f"{max(1.0, float(f'{value:.1g}')):g} s"
