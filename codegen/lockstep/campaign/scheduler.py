"""The chunks of a campaign on the workers of a Dask cluster.

A chunk is a pure function of the plan and its bounds: done again after a worker is lost it is the same, and its file is
written once more over itself. Files are written here, by one process, so nothing is lost and nothing counted twice.
"""

from typing import Any

from lockstep.campaign.compute import Keep, compute
from lockstep.campaign.plan import Plan
from lockstep.check.errors import ClaimError, LockstepError
from lockstep.lmi.processes.cluster import connected

RETRIES = 5
"""How often a chunk that failed on a worker is tried again; the workers a chunk may be lost with are Dask's to count."""


def over_dask(plan: Plan, todo: list[tuple[int, int]], address: str, keep: Keep) -> None:
    """Compute chunks on a cluster and keep each as it comes.

    Args:
        plan: sent along with every chunk, so that a new worker can take any.
        todo: the chunks.
        address: of the scheduler, such as `tcp://host:8786`.
        keep: called here with each chunk.

    Raises:
        ProblemError: dask.distributed is not installed, or nothing answers at the address.
        ClaimError: a chunk failed on the workers, with what they say.
    """
    with connected(address) as client:
        from dask.distributed import as_completed

        name = plan.identity[:16]
        futures = {
            client.submit(
                compute, plan, *chunk, key=f"lockstep-{name}-{chunk[0]}-{chunk[1]}", retries=RETRIES
            ): chunk
            for chunk in todo
        }
        try:
            for future in as_completed(list(futures), loop=client.loop):
                keep(*futures[future], _result(future, futures[future]))
        finally:
            client.cancel(list(futures))


def _result(future: Any, chunk: tuple[int, int]) -> Any:
    try:
        return future.result()
    except LockstepError:
        raise
    except Exception as error:
        raise ClaimError(
            f"the runs {chunk[0]} to {chunk[1] - 1} failed on the cluster: {type(error).__name__}: {error}"
        ) from None
