"""Campaigns of network faults: the nodes of a design on a bad network, against what is claimed of it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.check.errors import demand
from lockstep.model.agents.state_sizes import random_range
from lockstep.workflow.design_file import DESIGN_NAME, Design, as_design
from lockstep.workflow.generate import generated_files
from lockstep.workflow.output_files import of_file
from lockstep.workflow.output_folders import check_folder, write_files
from lockstep.workflow.runs.campaign import check_periods
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.campaign.network_faults.campaign import NetworkCampaign, NetworkGuarantee
    from lockstep.lmi.document import Stored


@dataclass(frozen=True, eq=False)
class NetworkRuns:
    """A campaign of faults and the folder that its table and summary were written to."""

    campaign: "NetworkCampaign"
    folder: Path

    @property
    def ok(self) -> bool:
        """Whether no run diverged, and what is claimed of such a network holds."""
        return self.campaign.ok

    def document(self) -> dict[str, Any]:
        """Return the result as plain JSON types."""
        return {**self.campaign.document(), "results": str(self.folder / "runs.csv")}


def network_campaign(
    design: Design | Path | str,
    faults: str,
    runs: int,
    output: Path | str,
    *,
    seed: int | None = None,
    horizon: float | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
) -> NetworkRuns:
    """Run the nodes of a design on a bad network, many times.

    Args:
        design: itself, its file, or a folder that holds one.
        faults: what the network does, as `NetworkFaults.parse` reads it.
        runs: how many.
        output: a folder for the table and the summary.
        seed: of all draws; by default the problem's.
        horizon: of each run, in s; by default the problem's.
        jobs: threads; None for one per core.
        progress: told what is being done.

    Raises:
        NotCertified: the checker refuses the design.
        ProblemError: bad input, no compiler, or a folder that cannot be written.
    """
    from joblib import cpu_count

    from lockstep.campaign.frequency_response import sampled_response
    from lockstep.campaign.network_faults.campaign import run_network
    from lockstep.campaign.network_faults.faults import NetworkFaults
    from lockstep.campaign.network_faults.loop import network_loop
    from lockstep.campaign.peaks import peaks
    from lockstep.campaign.plan import POINTS
    from lockstep.codegen.sampled_modes import sampled_controllers
    from lockstep.lmi.document import parse
    from lockstep.model.network import Network
    from lockstep.model.simulation.divergence import beyond

    network_faults, folder = NetworkFaults.parse(faults), Path(output)
    demand(runs >= 2, f"{runs} run", "campaign", "2 or more: every other one is disturbed")
    check_folder(folder)
    progress("proving the design", 0.0)
    found, path = as_design(design)
    with of_file(path):
        files = generated_files(found, exports=["messages"])
        stored = parse(json.loads(files[DESIGN_NAME]), DESIGN_NAME)
    problem = stored.problem
    time = problem.simulation.horizon if horizon is None else horizon
    check_periods(time, problem.controller.period)
    network = Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)
    weights = problem.performance
    progress("compiling the network", 0.1)
    loop = network_loop(network, files, weights, problem.controller.delay)
    progress("running", 0.2)
    response = sampled_response(
        network,
        sampled_controllers(stored, problem.controller.period),
        weights,
        problem.controller.period,
        problem.controller.delay,
    )
    given_seed = problem.simulation.seed if seed is None else seed
    about, reach = random_range(network.agent, problem.simulation.spread)
    campaign = run_network(
        loop,
        network_faults,
        _guarantee(stored),
        runs,
        peaks=peaks(network, response, weights, count=POINTS, seed=given_seed),
        seed=given_seed,
        horizon=time,
        starts=(about - reach, about + reach),
        most=0.1 * beyond(network.agent),
        jobs=jobs or cpu_count(),
    )
    write_files(folder, {"runs.csv": campaign.csv().encode(), "summary.json": campaign.summary().encode()})
    return NetworkRuns(campaign, folder)


def _guarantee(stored: "Stored") -> "NetworkGuarantee":
    """Return what the design claims of its messages, decided by the checker with the design; or nothing."""
    from lockstep.campaign.network_faults.campaign import EveryMessageArrives, NetworkGuarantee

    claims, sampled = stored.claims.messages, stored.claims.sampled
    if (stored.problem.performance.states == 0).any():
        return NetworkGuarantee()  # a campaign disturbs every state, and rho is no gain from all
    if claims is not None:
        return NetworkGuarantee(claims.rho, claims.messages)
    return NetworkGuarantee(sampled.rho if sampled.certified else None, EveryMessageArrives())
