"""What is proved of a design's controllers sampled and rounded, before or after they are printed.

Both sides meet here: `lockstep.lmi.sampled` proves and knows no C, this layer samples and rounds as `emit` does. What a
file says of its sampled controllers is never believed: its witnesses are put to the proof again.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import BoundNotProved, ProblemError
from lockstep.check.inequality import Certificate
from lockstep.check.modes import ModalCertificate
from lockstep.check.sampled.controller import PRECISIONS
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.sector import Sector, common_pair_weights, common_sector
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.discretize import discretize
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import (
    HeldController,
    Network,
    SampledRho,
    SampledVerdict,
    Weights,
    certify_sampled,
    max_period,
    sampled_rho,
)
from lockstep.lmi.sampled.performance import proves_rho
from lockstep.lmi.stored_bound import bound_again
from lockstep.model.assembly import network_of

FOR_PERIOD, NOT_FOR_PERIOD = "designed_for_period", "not_designed_for_period"
"""Of `sampled`: that the gains were designed for the sampled loop, not for the continuous one; or why they were not."""

PairWeights = Float[np.ndarray, " pairs"]


@dataclass(frozen=True)
class HeldVerdict:
    """What is proved of sampled, rounded controllers.

    verdict: at their period;  longest: at the largest period certified for the design's gains, sampled anew;  rho: the
    disturbance gain of the sampled loop, if proved.
    """

    verdict: SampledVerdict
    longest: SampledVerdict | None = None
    rho: SampledRho | None = None

    def figures(self) -> dict[str, Any]:
        """Return the contract's `sampled`, without witnesses."""
        return {
            **self.verdict.document(),
            "max_period": None if self.longest is None else self.longest.period,
            "rho": None if self.rho is None else self.rho.rho,
        }

    def document(self) -> dict[str, Any]:
        """Return the contract's `sampled` for a design file, with the witnesses: who reads it proves it again.

        Figures of the search (a spectral radius, a gain around phi) tell why a proof fails; beside one that holds they
        are left out, being computed and not proved.
        """
        searched = self.verdict.figures if self.verdict.certified else {}
        witness = self.verdict.witness
        return {
            **{key: value for key, value in self.figures().items() if key not in searched},
            "witness": None if witness is None else witness.document(),
            "rho_witness": None if self.rho is None else self.rho.witness.document(),
        }


def prove_design(stored: Stored, content: Mapping[str, Any], guess: PairWeights | None = None) -> HeldVerdict:
    """Prove what the C of a design file will compute: its gains sampled and rounded as `emit` does.

    The counts of roundings are those of full rows; C that skips zeros rounds less often.

    Args:
        stored: the design;  content: the same as JSON types: the witnesses in it are tried first.
        guess: pair weights to start from; by default those of the design.
    """
    period, delay = stored.problem.controller.period, stored.problem.controller.delay
    try:
        network = sampled_network(stored, period)
        controllers = sampled_controllers(stored, period)
    except (BoundNotProved, ProblemError) as error:
        return HeldVerdict(SampledVerdict(False, str(error), period, delay))
    return prove_controllers(stored, network, controllers, content, guess)


def prove_controllers(
    stored: Stored,
    network: Network,
    controllers: tuple[HeldController, ...],
    content: Mapping[str, Any],
    guess: PairWeights | None = None,
    *,
    longest: bool = True,
) -> HeldVerdict:
    """Prove sampled controllers of a design's network: agreement, rho, and the largest period of the design's gains.

    Args:
        stored: the design;  network: its agents, at the period of the controllers;  controllers: these.
        content: the design as JSON types: the witnesses in it are tried first.
        guess: pair weights to start from; by default those of the design.
        longest: whether to look for the largest period too.
    """
    if guess is None:
        guess = _guess(stored, content)
    verdict = certify_sampled(network, controllers, guess, witness=_witness_in(content))
    rho = None
    if verdict.certified:
        weights = weights_of(stored)
        rho = _stated_rho(network, controllers, weights, content) or sampled_rho(
            network, controllers, weights, guess
        )
    reach = None
    if longest:
        reach = _longest_stated(stored, network, guess, content) or longest_period(stored, network, guess)
        if verdict.certified and (reach is None or reach.period < verdict.period):
            reach = verdict
    return HeldVerdict(verdict, reach, rho)


def with_sampled(content: Mapping[str, Any], held: HeldVerdict) -> dict[str, Any]:
    """Return a design file's content with what is proved of its sampled controllers."""
    said = _said(content)
    design = {key: said[key] for key in (FOR_PERIOD, NOT_FOR_PERIOD) if key in said}
    return {**content, "sampled": {**held.document(), **design}}


def stated_rho(stored: Stored, content: Mapping[str, Any]) -> SampledRho | None:
    """Return the sampled rho of a design file with its witness, if that proves it now."""
    network = sampled_network(stored, stored.problem.controller.period)
    return _stated_rho(network, sampled_controllers(stored, network.period), weights_of(stored), content)


def longest_period(stored: Stored, network: Network, guess: PairWeights | None) -> SampledVerdict | None:
    """Return the verdict at the largest period certified for a design's gains, or None."""
    return max_period(network, lambda period: sampled_controllers(stored, period), guess)


def sampled_network(stored: Stored, period: float) -> Network:
    """Return the agents of a design in rationals, alpha and the entries being proved anew.

    Raises:
        BoundNotProved: alpha does not bound the nonlinearity, or an entry does not bound its slope.
    """
    problem = stored.problem
    bound = bound_again(stored).or_raise()
    loop = network_of(problem, bound).loop(stored.gains.order, exact_arithmetic=True)
    return Network(loop.plant, loop.d, stored.claims.alpha, period, problem.controller.delay, _sector(stored))


def _sector(stored: Stored) -> Sector | None:
    """Return the sector that takes the place of alpha where the continuous certificate uses entries."""
    c, lure = stored.proofs.certificate, stored.problem.agent().lure
    if not stored.claims.entries or c is None:
        return None
    if isinstance(c, ModalCertificate):
        m, m_entries = np.array([c.mu]), np.array(c.mu_entries)[:, None]
    else:
        m, m_entries = c.m, c.m_entries
    return common_sector(stored.claims.alpha, stored.claims.entries, m, m_entries, lure.G.shape[1], lure.H.shape[0])


def sampled_controllers(stored: Stored, period: float) -> tuple[HeldController, ...]:
    """Return a design's gains sampled with a period and rounded to the target type, as `emit` does.

    Raises:
        ProblemError: a gain has no value in the target type.
    """
    problem, gains = stored.problem, stored.gains
    table, real = problem.controller, RealType(problem.controller.real)
    sources: list[list[tuple[int, float]]] = [[] for _ in range(gains.N)]
    for listener, source, weight in problem.graph().edges:
        sources[listener - 1].append((source - 1, weight))
    controllers = []
    for i, heard in enumerate(sources):
        where = f"controller {i + 1}"
        sampled = discretize(gains.A[i], gains.B[i], gains.C[i], gains.D[i], period, table.discretization)
        weights = real.round(np.array([weight for _, weight in heard], dtype=float), where)
        controllers.append(
            HeldController.row_by_row(
                real.round(sampled.stacked(), where).astype(float),
                gains.order,
                tuple(source for source, _ in heard),
                weights.astype(float),
                PRECISIONS[table.real],
            )
        )
    return tuple(controllers)


def weights_of(stored: Stored) -> Weights:
    """Return R and Q of the design, for its rho."""
    problem = stored.problem
    return Weights(problem.state_weight(problem.agent().n), problem.controller_weight(stored.gains.order))


def _stated_rho(
    network: Network, controllers: tuple[HeldController, ...], weights: Weights, content: Mapping[str, Any]
) -> SampledRho | None:
    known = _rho_in(content)
    return known if known and proves_rho(sampled_loop(network, controllers), weights, known) else None


def _longest_stated(
    stored: Stored, network: Network, guess: PairWeights | None, content: Mapping[str, Any]
) -> SampledVerdict | None:
    """Return the verdict at the period that a design file states as its longest, if it is proved there."""
    period = _said(content).get("max_period")
    if not isinstance(period, int | float) or not 0 < period < 1e300 or _witness_in(content) is None:
        return None
    try:
        controllers = sampled_controllers(stored, float(period))
    except ProblemError:
        return None
    verdict = certify_sampled(network.at(float(period)), controllers, guess, thorough=False)
    return verdict if verdict.certified else None


def _said(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a design file says of its sampled controllers; it may say nothing."""
    said = content.get("sampled")
    return said if isinstance(said, Mapping) else {}


def _witness_in(content: Mapping[str, Any]) -> Witness | None:
    return Witness.from_document(_said(content).get("witness"))


def _rho_in(content: Mapping[str, Any]) -> SampledRho | None:
    rho, witness = _said(content).get("rho"), Witness.from_document(_said(content).get("rho_witness"))
    if witness is None or not isinstance(rho, int | float) or not 0 < rho < 1e300:
        return None
    return SampledRho(float(rho), witness)


def pair_weights(stored: Stored) -> PairWeights | None:
    """Return those of the continuous certificate, as far as one weight for each pair can stand for them."""
    c, sector = stored.proofs.certificate, _sector(stored)
    if not isinstance(c, Certificate):
        return None
    return c.m if sector is None else common_pair_weights(stored.claims.entries, c, sector)


def _guess(stored: Stored, content: Mapping[str, Any]) -> PairWeights | None:
    """Return pair weights to start from: those that proved rho of the sampled loop, else the continuous ones."""
    known = _rho_in(content)
    if known is not None and len(known.witness.m) == stored.gains.N * (stored.gains.N - 1) // 2:
        return known.witness.m
    return pair_weights(stored)
