"""Which starts a search pursues: fewer of a large loop, one after the other. The work itself is left out."""

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, published

from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.search import multistart
from lockstep.lmi.search.local_search import Polished
from lockstep.lmi.search.random_start import GainSearch, StartResult
from lockstep.lmi.search.smoothed_norm import Descended

SEARCH = GainSearch.of(arms().loop(2), claim(arms(), 2, ALPHA), 50.0)
CERTIFICATE = least_rho(SEARCH.loop, published().blocks, SEARCH.claim)


def searched(monkeypatch, rhos, certified, *, eliminates: bool) -> list[tuple[str, int]]:
    """Run a search whose start i comes to rhos[i]; return what was done to which."""
    done: list[tuple[str, int]] = []

    def run_start(_search, _score, _seed, index, _deadline):
        done.append(("begun", index))
        rho = rhos[index % len(rhos)]
        return StartResult(index, -1.0, Descended(np.zeros((1, 1, 1)), np.ones(1), 0.5, rho), sampled=rho)

    def resume(_search, _score, start, _deadline):
        done.append(("further", start.index))
        return start

    def pursue(_search, _score, index, _at, _rho, _deadline):
        done.append(("pursued", index))
        here = Polished(index, published().blocks, CERTIFICATE, 1.0, 1.0, (1.0,))
        return None, here if index in certified else None

    for name, instead in (("run_start", run_start), ("resume", resume), ("_pursue", pursue)):
        monkeypatch.setattr(multistart, name, instead)
    monkeypatch.setattr(multistart, "eliminates_P", lambda _loop: eliminates)
    monkeypatch.setattr(multistart, "_settled", lambda _search, best, _score, _deadline: best)
    multistart.search_gains(SEARCH, starts=4, seed=0, jobs=1)
    return done


def of(done, what: str) -> list[int]:
    return [index for word, index in done if word == what]


@pytest.mark.parametrize(
    ("certified", "pursued"),
    [({2}, [2]), ({3, 0}, [2, 3]), ({1}, [2, 3, 1]), (set(), [2, 3, 1, 0])],
    ids=["the first", "the second", "one not taken further", "none"],
)
def test_of_a_large_loop_starts_are_pursued_until_one_has_a_certificate(monkeypatch, certified, pursued):
    done = searched(monkeypatch, [5.0, 4.0, 2.0, 3.0], certified, eliminates=True)
    assert of(done, "begun") == [0, 1, 2, 3]
    assert of(done, "further") == [2, 3], "half of them, the best"
    assert of(done, "pursued") == pursued


def test_of_a_large_loop_without_any_rho_the_nearest_start_says_how_far_it_came(monkeypatch):
    done = searched(monkeypatch, [np.inf], set(), eliminates=True)
    assert len(of(done, "pursued")) == 1
    assert not of(done, "further")


def test_of_a_small_loop_all_that_are_asked_for_are_pursued(monkeypatch):
    done = searched(monkeypatch, [5.0, 4.0, 2.0, 3.0], {0}, eliminates=False)
    assert len(of(done, "begun")) == 4 * multistart.DRAWN
    assert len(of(done, "pursued")) == 4
