"""A search on a real cluster of processes, one of which is killed on the way: the design is the one made here."""

import os
import signal

import pytest

import lockstep
from cart import cart
from lockstep.check.errors import ProblemError
from lockstep.model.problem import Problem, parse_problem

distributed = pytest.importorskip("dask.distributed", exc_type=ImportError)


@pytest.fixture(scope="module")
def carts() -> Problem:
    return parse_problem(
        cart("f")
        + """
        [network]
        agents = 2
        edges = [[1, 2], [2, 1]]
        [design]
        order = 0
        gain_limit = 20.0
        starts = 2
        """
    )


@pytest.fixture(scope="module")
def here(carts: Problem) -> "lockstep.Design":
    return lockstep.design(carts, jobs=1)


@pytest.mark.slow
def test_one_worker_is_killed_and_the_design_is_the_same(carts, here):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs="CRITICAL"
    ) as cluster:
        pids = [worker.pid for worker in cluster.workers.values()]
        assert os.getpid() not in pids
        killed = []

        def kill_one(what: str, part: float) -> None:
            if "searching" in what and part > 0 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        there = lockstep.design(carts, scheduler=cluster.scheduler_address, progress=kill_one)
    assert killed
    assert there.text() == here.text()


@pytest.mark.slow
def test_no_scheduler_answers(carts):
    with pytest.raises(ProblemError, match="no scheduler answers at"):
        lockstep.design(carts, scheduler="tcp://127.0.0.1:1")


def test_what_is_no_address_is_refused(carts):
    with pytest.raises(ProblemError, match="`somewhere` is no address"):
        lockstep.design(carts, scheduler="somewhere")


def test_a_limit_of_time_is_refused(carts):
    with pytest.raises(ProblemError, match="a time limit is given"):
        lockstep.design(carts, scheduler="tcp://127.0.0.1:8786", time_limit=10.0)
