"""The same campaign on a real cluster of processes, one of which is killed on the way: the table is the same, bit by bit."""

import os
import signal
from pathlib import Path

import pytest

from lockstep.campaign import run_campaign
from lockstep.campaign import scheduler as over
from lockstep.campaign.compute import chunks
from lockstep.campaign.plan import CHUNK
from lockstep.campaign.store import Store
from lockstep.check.errors import ClaimError, ProblemError
from lockstep.lmi.processes import cluster as cluster_of_dask
from lockstep.workflow.runs.campaign import CampaignOptions, planned

distributed = pytest.importorskip("dask.distributed", exc_type=ImportError)

DESIGN = Path("generated") / "flexible_joint_arms"
RUNS = 16 * CHUNK + 40


@pytest.fixture(scope="module")
def plan(root):
    return planned(root / DESIGN, CampaignOptions(horizon=1.0, seed=5))[0]


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs="CRITICAL"
    ) as running:
        yield running


@pytest.mark.slow
def test_one_worker_is_killed_and_nothing_is_lost_or_counted_twice(plan, cluster, tmp_path, monkeypatch):
    alone = run_campaign(plan, RUNS, tmp_path / "alone", jobs=2)
    pids = [worker.pid for worker in cluster.workers.values()]
    assert len(set(pids)) == 3
    assert os.getpid() not in pids
    kept, killed = [], []
    keep = Store.keep

    def keep_and_kill(store, begin, end, table):
        keep(store, begin, end, table)
        kept.append((begin, end))
        if len(kept) == 2:
            os.kill(pids[1], signal.SIGKILL)
            killed.append(len(chunks(RUNS)) - len(kept))

    monkeypatch.setattr(Store, "keep", keep_and_kill)
    together = run_campaign(plan, RUNS, tmp_path / "cluster", scheduler=cluster.scheduler_address)
    assert killed == [len(chunks(RUNS)) - 2], "it was killed while most was still to be done"
    assert sorted(kept) == chunks(RUNS), "each chunk is kept once"
    assert together.table["run"].tolist() == list(range(RUNS))
    for here, there in zip(alone.table.values, together.table.values, strict=True):
        assert here.tobytes() == there.tobytes()
    assert (together.folder / "summary.json").read_bytes() == (alone.folder / "summary.json").read_bytes()
    assert together.ok


def test_a_campaign_begun_here_goes_on_there(plan, cluster, tmp_path):
    first = run_campaign(plan, CHUNK, tmp_path)
    second = run_campaign(plan, 2 * CHUNK, tmp_path, scheduler=cluster.scheduler_address)
    assert second.computed == CHUNK
    assert second.table.values[:CHUNK].tobytes() == first.table.values.tobytes()


def _failing(*_):
    raise RuntimeError("no such luck")


@pytest.mark.slow
def test_what_fails_on_the_cluster_is_told(plan, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(over, "compute", _failing)
    with pytest.raises(ClaimError, match="runs 0 to 7 failed on the cluster: RuntimeError: no such luck"):
        run_campaign(plan, 8, tmp_path, scheduler=cluster.scheduler_address)


def test_no_scheduler_at_the_address(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster_of_dask, "CONNECT_SECONDS", 0.2)
    with pytest.raises(ProblemError, match="no scheduler answers"):
        run_campaign(plan, 8, tmp_path, scheduler="tcp://127.0.0.1:9")
    with pytest.raises(ProblemError, match="no scheduler answers"):
        run_campaign(plan, 8, tmp_path, scheduler="nonsense://")
