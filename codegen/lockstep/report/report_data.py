"""What a report is made from, and the run it shows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.lmi.analysis.covered_start import times_covered, times_in_domain
from lockstep.lmi.analysis.decimals import below
from lockstep.lmi.document import Stored
from lockstep.lmi.trade_off.pareto import ParetoPoint
from lockstep.model.checks import CheckReport
from lockstep.model.network import Network
from lockstep.model.problem import Problem
from lockstep.model.simulation import Diverged, Trajectory, simulate
from lockstep.model.simulation.divergence import left_domain
from lockstep.model.simulation.from_problem import FINEST, Changes, scenario_of, step_of
from lockstep.verification.closed_loop.software_in_the_loop import reference_controllers
from lockstep.verification.verify import VerifyReport

CLIPPED = "controller steps met a limit of an input, and rho is proved without saturation"
UNSETTLED = "where nothing is proved: it may settle with a longer `horizon`, or never"
STAYING = "that agents stay in their domain"
MORE_STAYS = "a narrower `[network] leader`, smaller gains or a wider [agent.domain] may enlarge that"
LITTLE = 0.5
"""Of how far apart a state was at most: where it has not come below at the end of a run, it may never."""

MOST_STEPS = 20_000
"""Of all controllers together in the run: some three seconds of work. The three arms take 12 000 in 20 s."""

MOST_INSTANTS = 100_000
"""Of its record: with long periods the agents are recorded between the samples as well."""


@dataclass(frozen=True, eq=False)
class Facts:
    """What is known of a folder about to be written.

    stored: design.json as it will be written;  manifest: manifest.json, with the claims that the C's headers make;
    checks, verified: what `check` and `verify` found;  trajectory: a run of the shipped controllers, or None, and then
    `no_run` says why;  trade_off: gains around the design, if they were asked for.
    """

    stored: Stored
    manifest: Manifest
    checks: CheckReport
    verified: VerifyReport
    trajectory: Trajectory | None
    no_run: str = ""
    trade_off: tuple[ParetoPoint, ...] = ()

    @property
    def problem(self) -> Problem:
        """The problem of the design."""
        return self.stored.problem

    @property
    def uncovered(self) -> tuple[str, ...]:
        """What takes the run out of what is proved: a domain that is left, saturation, a start beyond the claims'."""
        run, claims = self.trajectory, self.stored.claims
        if run is None:
            return (f"the report shows no run: {self.no_run}",) if self.no_run else ()
        left = left_domain(run.t, run.x, self.problem.agent()) if claims.scope == "local" else ""
        inside, sampled = claims.initial_set, claims.sampled
        away = run.errors()[0]
        most = times_in_domain(self.problem, away) if claims.scope == "local" else np.inf
        without = times_covered(sampled.radius, sampled.half_axes, away, most)
        clipped = times_covered(sampled.clipped_radius, sampled.clipped_half_axes, away, most)
        stays = times_covered(inside.radius, inside.half_axes, away) if inside else 1.0
        apart = "" if max(without, clipped) >= 1 else self._apart_at_end(run)
        calm = " and without disturbances" * bool(run.xi.any())
        said = (
            (left, f"{left}; the certificate is for agents inside"),
            (run.clipped, f"{run.clipped} {CLIPPED}"),
            (run.clipped, self._saturated_from(without, clipped)),
            (run.clipped and apart, f"{apart}, {UNSETTLED}"),
            (run.faults, f"{run.faults} steps reported a fault"),
            (
                stays < 1,
                f"{STAYING} is proved from {below(stays, 3)} times this start only{calm}: {MORE_STAYS}",
            ),
        )
        return tuple(f"in the run of the report, {text}" for holds, text in said if holds)

    def _apart_at_end(self, run: Trajectory) -> str:
        """Say of the state that has settled least how far apart it is at the end, if by half of its most or more."""
        apart, agent = np.ptp(run.less_offsets, axis=1), self.problem.agent()
        noise = np.finfo(np.float32).eps * np.abs(run.x).max(axis=(0, 1)) + np.finfo(float).tiny
        part = apart[-1] / np.maximum(apart.max(axis=0), noise)
        k = int(part.argmax())
        shown = f"{apart[-1, k]:.3g} {agent.shown_units.get(agent.states[k], '')}".rstrip()
        return f"{agent.states[k]} is {shown} apart at its end" if part[k] >= LITTLE else ""

    def _saturated_from(self, without: float, clipped: float) -> str:
        """Say from how many times the start of a run inputs do not saturate, and agents agree, and what makes that more."""
        design = self.problem.design
        slower, static = ", a lower `decay`" * bool(design.decay), ", `order = 0`" * bool(self.problem.order)
        how = f" (a `gain_limit` below {design.gain_limit:g}, all else as in the file or by default{slower}{static})"
        return (
            f"no saturation is proved {f'from {below(without, 3)} times this start' if without else 'at all'}"
            f"{f', agreement with saturation from {below(clipped, 3)} times it' if clipped else ''}: smaller gains enlarge"
            f" that{how * (design.method != 'given')}"
        )

    @property
    def network(self) -> Network:
        """The agents on their graph."""
        problem = self.problem
        return Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)


def gather(
    files: Mapping[str, str],
    stored: Stored,
    checks: CheckReport,
    verified: VerifyReport,
    trade_off: tuple[ParetoPoint, ...] = (),
) -> Facts:
    """Return the facts of a generated folder that is not written yet; this runs the loop.

    Args:
        files: relative path -> text, as generated.
        stored: design.json among them.
        checks, verified: what was found of them.
        trade_off: gains around the design, if they were asked for.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    try:
        trajectory, why = run_shipped(stored.problem, manifest), ""
    except Diverged as error:
        trajectory, why = None, str(error)
    return Facts(stored, manifest, checks, verified, trajectory, why, trade_off)


def run_shipped(problem: Problem, manifest: Manifest) -> Trajectory:
    """Run the agents, nonlinear, under the controllers that ship: their reference, equal to the C to the last bit.

    The start, the horizon, the disturbance and the channel are those of [simulation]; a long run is cut short, gain
    errors, which are about continuous controllers, are left out, and so is a disturbance that takes a search.

    Raises:
        Diverged: a state left all bounds.
    """
    table = problem.simulation
    kind = "none" if table.disturbance.kind == "worst" else table.disturbance.kind
    simulation = table.model_copy(update={"perturbation": None})
    plain = Problem(problem.file.model_copy(update={"simulation": simulation}))
    periods = max(1, MOST_STEPS // len(manifest.agents))
    step = max(FINEST, step_of(plain, table.horizon, held=kind in ("none", "noise")))
    horizon = min(table.horizon, periods * manifest.period, MOST_INSTANTS * step)
    return simulate(
        Network(problem.agent(), problem.graph(), problem.agents_B()),
        reference_controllers(manifest, delay=problem.controller.delay),
        scenario_of(plain, Changes(horizon=horizon, disturbance=kind), sampled=True),
    )
