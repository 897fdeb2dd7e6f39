"""The largest set of initial disagreements from which agents stay in their domain, by the checker."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, Any

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.initial_set import (
    Domain,
    InitialSet,
    axes_text,
    box_text,
    holds_ball,
    largest_level,
    on_disagreement,
    squared_distance,
    unavailable,
)
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.numbers import Matrix, as_floats, as_fraction, exact, rounded_down
from lockstep.check.psd import decide_positive_definite
from lockstep.check.system.network import ExactNetwork
from lockstep.lmi.analysis.decimals import below, round_down
from lockstep.lmi.design_json import initial_set_document
from lockstep.lmi.sampled.half_axes import largest_half_axes
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.arguments import arguments_text


@dataclass(frozen=True)
class Unavailable:
    """No set of initial disagreements can be given, and why."""

    reason: str

    def text(self) -> str:
        """Return what this says to people."""
        return f"that agents stay in their domain is not proved: {self.reason}"

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON types."""
        return {"available": False, **self.remarks()}

    def remarks(self) -> dict[str, Any]:
        """Return what people are told of it."""
        return {"text": self.text(), "reason": self.reason}


@dataclass(frozen=True)
class InitialStates(InitialSet):
    """A set of initial states, and what people are told of it beyond the claim.

    agent, argument: which v_j, from 1, of which agent would reach a side first, 0 where it is not known;  arguments: what
    v_1, v_2, ... are, in the names of the states, which are the others, and have units.
    """

    agent: int = 0
    argument: int = 0
    arguments: str = ""
    states: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def named(cls, claimed: InitialSet, of: Agent, **first: int) -> "InitialStates":
        """Return a set with the names and units of an agent's states; first: `agent` and `argument`, where they are known."""
        names = {"arguments": arguments_text(of), "states": of.states, "units": of.units}
        return cls(**(vars(claimed) | first | names))

    def text(self) -> str:
        """Return what this says to people."""
        named = (one.split(" = ") for one in self.arguments.split(", "))
        names = {one[0]: one[1] for one in named if len(one) == 2 and "..." not in one[1]}
        inside = re.sub(r"\bv\d+\b", lambda found: names.get(found[0], found[0]), box_text(self.inner))
        axes = f", or {axes_text(self.half_axes, self.states, self.units)}," if self.half_axes else ""
        v = f"v{self.argument}"
        first = f"; {names.get(v, v)} of agent {self.agent} limits it" * bool(self.agent)
        return (
            f"agent {self.leader} leads. While it moves by itself, with no command of its own, and stays in {inside} "
            "([network] leader), every agent stays in its domain, and all agree, "
            f"from |x_d(0)| <= {below(self.radius)}{axes} with all controllers at rest "
            f"(|x_d|^2 = sum |x_i - mean|^2), or from V(0) <= {below(self.level)} with the leader's at rest: proved of the "
            f"continuous controllers, not of the sampled ones{first}"
        )

    def document(self) -> dict[str, Any]:
        """Return it with what people are told of it."""
        return {"available": True, **self.remarks(), **initial_set_document(self)}

    def remarks(self) -> dict[str, Any]:
        """Return what people are told of it, beyond the claim."""
        first = {"first": {"agent": self.agent, "argument": self.argument}} if self.agent else {}
        return {"text": self.text(), "arguments": self.arguments, **first}


def initial_set(
    network: ExactNetwork,
    certificate: Certificate | ModalCertificate,
    domain: Domain,
    inner: Box,
    agent: Agent,
) -> InitialStates | Unavailable:
    """Return the largest set V <= c of initial disagreements from which the agents stay in their domain.

    Args:
        network: the agents and the graph.
        certificate: decided for the bound that was proved on the domain.
        domain: the box;  inner: the part of it that the leader is to stay in.
        agent: whose states have names and units.

    Raises:
        ProblemError: an inner box that is not inside the box on every side, or a P that does not fit the network.
    """
    reason = unavailable(network, certificate, domain.box)
    if reason or isinstance(certificate, ModalCertificate):
        return Unavailable(reason or "")
    c, i, j = largest_level(network, certificate, domain, inner)
    level, P = rounded_down(c), on_disagreement(network, certificate)
    radius = _root_below(Fraction(level) / _ratio_above(P, squared_distance(network)))
    energy = rounded_down(Fraction(level) / Fraction(certificate.rho) ** 2)
    if not all(0 < figure < math.inf for figure in (level, radius, energy)):
        return Unavailable("its figures are beyond the range of doubles")
    D, nowhere = as_floats(squared_distance(network)), np.zeros((1, agent.n))
    a = largest_half_axes(D, as_floats(P), level, nowhere, radius)
    axes = a if a and holds_ball(network, certificate, Fraction(level), a) else None
    found = InitialSet(network.graph.roots[0], domain.box, inner, level, radius, energy, axes)
    return InitialStates.named(found, agent, agent=i + 1, argument=j + 1)


def _ratio_above(P: Matrix, D: Matrix) -> Fraction:
    """Return a number k with z' P z <= k z' D z for all z, P > 0 and D > 0: close to the least, and proved.

    Doubles propose it and the rationals decide; each step asks for ten times more room. The trace of D^-1 P, the sum of
    all ratios, is no less than the largest and needs no doubles; a little more leaves room for the proof.
    """
    largest = _largest_ratio(as_floats(P), as_floats(D))
    for room in 10.0 ** np.arange(-12, 0):
        ratio = largest * (1.0 + float(room))
        if math.isfinite(ratio) and decide_positive_definite(exact(ratio) * D - P).positive:
            return Fraction(ratio)
    ratios = fmpq_mat(D.tolist()).solve(fmpq_mat(P.tolist()))
    trace = as_fraction(sum((ratios[k, k] for k in range(len(P))), start=fmpq(0)))
    return trace * (1 + Fraction(1, 10**12))


def _largest_ratio(P: Annotated[np.ndarray, "n n"], D: Annotated[np.ndarray, "n n"]) -> float:
    try:
        factor = np.linalg.inv(np.linalg.cholesky(D))
        return float(np.linalg.eigvalsh(factor @ P @ factor.T)[-1])
    except np.linalg.LinAlgError:
        return math.nan


def _root_below(square: Fraction) -> float:
    """Return a double whose square is at most that: the square root, rounded down."""
    r = math.sqrt(rounded_down(square))
    while Fraction(r) * Fraction(r) > square:
        r = math.nextafter(r, 0.0)
    return r


def sampled_rate(period: float, *decays: float | None) -> float | None:
    """Return the rate in 1/s of a disagreement of which a V falls by one of these factors a sample, rounded down, or None."""
    decay = min((one for one in decays if one), default=1.0)
    return round_down(-math.log(decay) / (2 * period)) if decay < 1 else None
