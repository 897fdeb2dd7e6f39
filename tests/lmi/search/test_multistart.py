"""Which starts a search pursues: fewer of a large loop, one after the other. The work itself is left out."""

from dataclasses import replace

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, problem, published

from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.methods.certified import gain_search
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import local_search, multistart
from lockstep.lmi.search.barrier import BarrierPoint
from lockstep.lmi.search.local_search import Polished
from lockstep.lmi.search.random_start import (
    STARTS_PER_LOWER,
    GainSearch,
    Homotopy,
    StartResult,
    resume,
    run_start,
)
from lockstep.lmi.search.smoothed_norm import Descended
from lockstep.lmi.search.stopping import NEVER
from lockstep.model.assembly import network_of

SEARCH = GainSearch.of(arms().loop(2), claim(arms(), 2, ALPHA), 50.0)
CERTIFICATE = least_rho(SEARCH.loop, published().blocks, SEARCH.claim)


def searched(
    monkeypatch, rhos, certified, *, eliminates: bool, stable=(), last: bool = True
) -> list[tuple[str, int]]:
    """Run a search whose start i comes to rhos[i], stable too where it is infinite; return what was done to which."""
    done: list[tuple[str, int]] = []

    def run_start(_search, _score, _seed, index, _deadline):
        done.append(("begun", index))
        rho = rhos[index % len(rhos)]
        abscissa = -1.0 if np.isfinite(rho) or not stable or index in stable else 1.0
        return StartResult(index, abscissa, Descended(np.zeros((1, 1, 1)), np.ones(1), 0.5, rho), sampled=rho)

    def resume(_search, _score, start, _deadline):
        done.append(("further", start.index))
        return start

    def pursue(_search, _score, start, _rho, _deadline):
        done.append(("pursued", start.index))
        here = Polished(start.index, published().blocks, CERTIFICATE, 1.0, 1.0, (1.0,))
        return None, here if start.index in certified else None

    for name, instead in (("run_start", run_start), ("resume", resume), ("_pursue", pursue)):
        monkeypatch.setattr(multistart, name, instead)
    monkeypatch.setattr(multistart, "eliminates_P", lambda _loop: eliminates)
    monkeypatch.setattr(multistart, "_settled", lambda _search, best, _score, _deadline: best)
    multistart.search_gains(SEARCH, starts=4, seed=0, jobs=1, last=last)
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


@pytest.mark.parametrize(("large", "begun"), [(False, 16), (True, 8)])
def test_half_of_the_starts_that_are_drawn_are_taken_further(monkeypatch, large, begun):
    monkeypatch.setattr(GainSearch, "is_large", large)
    done = searched(monkeypatch, [20.0 - k for k in range(16)], set(), eliminates=False)
    assert of(done, "begun") == list(range(begun))
    assert of(done, "further") == list(range(begun - 1, begun // 2 - 1, -1)), "the half with the least rho"


@pytest.mark.parametrize(
    ("asked", "strides"), [(None, 2), (0.6, 3)], ids=["small rho", "a rho that is asked for"]
)
def test_a_start_ends_at_the_first_stride_that_hardly_gains(monkeypatch, asked, strides):
    """10 %, 0.5 %, a half: the second is the last one, unless it leaves rho above one that is asked for."""
    taken = []

    def stride(_search, point, _length, _deadline):
        taken.append([0.9, 0.995, 0.5][len(taken)])
        return replace(point, certificate=replace(point.certificate, rho=taken[-1] * point.certificate.rho))

    here = BarrierPoint(published().blocks, CERTIFICATE)
    monkeypatch.setattr(multistart, "homotopy", lambda *_: Homotopy(here, 1.0, 1.0))
    monkeypatch.setattr(local_search, "_stride", stride)
    monkeypatch.setattr(local_search, "_with_alpha_raised", lambda _search, best, _rho, _deadline: best)
    start = StartResult(0, -1.0, Descended(here.K, np.ones(1), 0.5, CERTIFICATE.rho))
    first = SEARCH.units.certificate(CERTIFICATE).rho
    multistart._pursue(SEARCH, None, start, asked and asked * first, NEVER)
    assert len(taken) == strides


@pytest.mark.parametrize(
    ("stable", "last", "begun"),
    [({20}, False, 8), ({20}, True, 16), ({7}, False, 16)],
    ids=["another limit is next", "nothing is next", "one start is stable"],
)
def test_where_larger_gains_are_next_half_of_the_starts_show_that_none_is_stable(
    monkeypatch, stable, last, begun
):
    """Of two magnetic bearings no start is stable with gains up to 0.9, and the next attempt has larger ones."""
    done = searched(monkeypatch, [np.inf], set(), eliminates=False, stable=stable, last=last)
    assert len(of(done, "begun")) == begun


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1])
def test_a_start_with_a_state_more_is_no_worse_than_that_without(index: int) -> None:
    """A state beside them that nothing hears changes no rho: the descent begins next to what the order below came to."""
    posed = problem(
        dynamics={"a": "b", "b": "-a - sin(a) + u"},
        outputs={"y1": "a"},
        network='agents = 3\ntopology = "path"',
        design="order = 2\ngain_limit = 10.0",
    )
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound), claim_of(posed, bound)
    search = gain_search(posed, network, asked, 0.0, None)
    assert search.lower is not None
    low = resume(search.lower, None, run_start(search.lower, None, 0, index))
    start = run_start(search, None, 0, STARTS_PER_LOWER * (index + 1) - 1)
    assert np.isfinite(low.at.rho)
    assert start.at.K.shape == (3, 3, 3)
    # The couplings begin at a part of their unit, so that the descent does not begin with the rho of the order below.
    assert start.at.rho <= 1.01 * low.at.rho


def test_static_gains_and_gains_with_errors_of_other_kinds_have_no_order_below() -> None:
    """A, B and C have errors from order 1 on: those of a static gain have other multipliers."""
    for table, lower in (
        ("order = 0", False),
        ("order = 1", True),
        ("order = 1\nfragility = { D = 0.01 }", False),
    ):
        posed = problem(
            dynamics={"x": "u - sin(x)"}, outputs={"y": "x"}, design=f"gain_limit = 10.0\n{table}"
        )
        bound = proved_bound(posed)
        search = gain_search(posed, network_of(posed, bound), claim_of(posed, bound), 0.0, None)
        assert (search.lower is not None) is lower
