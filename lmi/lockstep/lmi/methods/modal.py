"""Method `modal`: identical controllers for any number of agents on a graph that is symmetric in some metric.

    metric      w with W L symmetric, exactly: undirected graphs, or normalised by the listener's in-degree
    segments    [lower, upper] around the spectrum, cut where lambda grows by `RATIO`, one P for each
    gains       one K for all agents from `search.modes`, from several starts
    proof       `prove_modes`: short decimals, decided exactly by `modes.decide_modes`

The size of the problem does not depend on N: only the bounds on the spectrum of L are N by N.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import ModalCertificate, Modes, Segment, check_covered, decide_modes
from lockstep.check.errors import Infeasible, NotCertified, demand
from lockstep.check.numbers import Vector, as_float, as_floats
from lockstep.check.psd import MOST_ROWS
from lockstep.check.system.graph import Digraph
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.decimals import round_up, rounded_storage
from lockstep.lmi.analysis.gain_limit import limit_text
from lockstep.lmi.analysis.rounding import short_gains
from lockstep.lmi.methods.modal_interval import CommonSearch
from lockstep.lmi.methods.modal_search import ModalCandidate, drawn, from_start
from lockstep.lmi.methods.modal_witness import HALVINGS, ModalWitness, fine_witness, witness
from lockstep.lmi.search.common_gains import ModalSearch
from lockstep.lmi.shapes import GainLimit
from lockstep.model.network import Network

OUTSIDE = 1e-9
"""How far outside the computed eigenvalues the bounds are put, relative to lambda_N: far above rounding errors."""

RATIO = 4.0
"""How far apart the ends of a segment may be while gains are searched for: finer ones cost time."""

_ANY = Claim(0.0, np.eye(1), np.eye(1), np.zeros((1, 4)))
"""A claim of nothing, for what a graph alone decides."""

RATIOS = (2.0, 4.0, 16.0, 64.0, 256.0, 1024.0)
"""Ratios of the largest to the smallest eigenvalue that are tried where the one asked for is too large."""

FIRST_ROUNDS, KEPT = 4, 3
"""Of gains with one P: rounds of the search for all, and how many of the best go on."""

MOST_AGENTS = MOST_ROWS + 1
"""Of one graph: whether its eigenvalues are in the interval is decided by a matrix of a row less."""

POORLY = "docs/graphs.md says what does for poorly connected graphs"

SLACKS = (1e-3, 5e-3, 2e-2, 1e-1)
"""How far above the least rho the certificate is taken, so that rounding fits."""

FEWEST_DIGITS, MOST_DIGITS = 4, 15


def design_modes(
    network: Network,
    claim: Claim,
    order: int,
    gain_limit: GainLimit,
    *,
    starts: int,
    seed: int,
    rate: float | None = None,
    tell: Callable[[float], None] | None = None,
) -> Gains:
    """Search for one K that all agents use.

    Raises:
        ProblemError: the graph, the agents or the request are not covered.
        Infeasible: no gains were found; with the part of alpha that was reached.
    """
    known, few = (
        check_covered(network.matrices, claim),
        network.spectrum is not None or network.N <= MOST_AGENTS,
    )
    demand(few, f"{network.N} agents", "modal", f"at most {MOST_AGENTS} of one graph, or [network] spectrum")
    modes = Modes(network.plant, order, network.decay)
    search = ModalSearch.of(modes, claim, segment_ends(network, known), gain_limit, rate)
    if network.spectrum is not None:
        return shared_gains(_common(search, starts, seed, rate, tell), order, 1)
    best: ModalCandidate | None = None
    for index in range(starts):
        if tell is not None:
            tell(index / starts)
        found = from_start(search, seed, index)
        if best is None or (found.sigma, -found.fraction) < (best.sigma, -best.fraction):
            best = found
    if best is None or best.K is None:
        reached, ratio = 0.0 if best is None else best.fraction, float(search.ends[-1] / search.ends[0])
        served = largest_ratio(search, seed, rate, common=False) if ratio > RATIO else 1.0
        wide = f"; that is a ratio of {ratio:.4g}, and the largest up to {search.ends[-1]:.4g} that gains were found for is"
        raise Infeasible(
            f"no identical gains of order {order} within {limit_text(gain_limit)} were found that carry alpha ="
            f" {claim.alpha:.6g} for every lambda from {search.ends[0]:.4g} to {search.ends[-1]:.4g}; the best of"
            f" {starts} starts carried {reached:.3g} of it"
            + (f"{wide} {served:.4g}: {POORLY}" if ratio > RATIO else ""),
            alpha=claim.alpha,
            fraction=reached,
            reachable_alpha=reached * claim.alpha,
            ratio=ratio,
            reachable_ratio=served,
        )
    return shared_gains(best.K, order, network.N)


def largest_ratio(search: ModalSearch, seed: int, rate: float | None, *, common: bool) -> float:
    """Return the largest ratio b / a, of those in `RATIOS` and up to the b of a search, for which gains are found; else 1."""
    upper, served = float(search.ends[-1]), 1.0
    for ratio in RATIOS:
        if ratio >= upper / search.ends[0]:
            break
        count = max(1, math.ceil(math.log(ratio) / math.log(RATIO) - 1e-6))
        ends = np.geomspace(upper / ratio, upper, count + 1)
        part = ModalSearch.of(search.modes, search.claim, ends, search.gain_limit, rate)
        if common:
            ends_of = upper / ratio, upper
            one = CommonSearch(search.modes, search.claim, ends_of, search.gain_limit, rate or 0.0)
            holds = any(one.has_one_P(K) for K in drawn(part, seed, 0))
        else:
            holds = from_start(part, seed, 0).K is not None
        if not holds:
            break
        served = ratio
    return served


def _common(
    search: ModalSearch, starts: int, seed: int, rate: float | None, tell: Callable[[float], None] | None
) -> Float[np.ndarray, "a b"]:
    """Search for one K with one P on all of the spectrum: what proves switching, and graphs of any size."""
    a, b = search.ends[0], search.ends[-1]
    common = CommonSearch(search.modes, search.claim, (float(a), float(b)), search.gain_limit, rate or 0.0)
    found = list[tuple[float, Float[np.ndarray, "a b"]]]()
    for index in range(starts):
        if tell is not None:
            tell(index / starts)
        found += [common.improved(K, FIRST_ROUNDS) for K in drawn(search, seed, index)]
    first = sorted((one for one in found if one[0] < np.inf), key=lambda one: one[0])[:KEPT]
    best = min((common.improved(K) for _, K in first), key=lambda one: one[0], default=None)
    if best is None:
        reached = largest_ratio(search, seed, rate, common=True)
        raise Infeasible(
            f"no identical gains of order {search.modes.order} within {limit_text(search.gain_limit)} were found with one P"
            f" for every lambda from {a:.4g} to {b:.4g}, a ratio of {b / a:.4g}; the largest ratio up to {b:.4g} for which"
            f" some were found is {reached:.4g}: {POORLY}",
            alpha=search.claim.alpha,
            ratio=b / a,
            reachable_ratio=reached,
        )
    return np.asarray(short_gains(best[1][None], search.gain_limit)[0])


def shared_gains(K: Float[np.ndarray, "a b"], order: int, N: int) -> Gains:
    """Return the same gains for all agents."""
    return Gains.from_blocks(np.stack([K] * N), order)


def segment_ends(network: Network, known: Vector) -> Float[np.ndarray, " s"]:
    """Return lower, the cuts between segments in short decimals, and upper."""
    if network.spectrum is not None:
        return np.array(network.spectrum)
    lower, upper = spectrum_bounds(network.graph, known)
    count = max(1, math.ceil(math.log(upper / lower) / math.log(RATIO) - 1e-6))
    cuts = [float(f"{lower * (upper / lower) ** (i / count):.4g}") for i in range(1, count)]
    return np.array([lower, *cuts, upper])


def prove_modes(network: Network, gains: Gains, claim: Claim) -> ModalCertificate:
    """Find a certificate for identical gains and prove it exactly.

    Raises:
        NotCertified: no certificate was found, or none survived the exact check.
    """
    modes, K = Modes(network.plant, gains.order, network.decay), gains.blocks[0]
    spread = as_float(max(check_covered(network.matrices, claim)))
    ends, least = least_witness(network, gains, claim)
    if least is None:
        raise NotCertified(
            f"no certificate was found for these gains at alpha = {claim.alpha:.6g}", alpha=claim.alpha
        )
    for slack in SLACKS:
        rho = round_up(math.sqrt(least.sigma * spread) * (1 + slack))
        inside = witness(modes, K, claim, ends, rho**2 / spread)
        found = None if inside is None else _shortest(network, gains, claim, ends, rho, inside)
        if found is not None:
            return found
    raise NotCertified(
        f"the solver's candidate at rho = {math.sqrt(least.sigma * spread):.6g} did not survive the exact check",
        rho=math.sqrt(least.sigma * spread),
        alpha=claim.alpha,
    )


def covered_graphs(network: Network, certificate: ModalCertificate) -> str:
    """Say which graphs a certificate of the modes covers, for people."""
    ends, spectrum = certificate.ends, network.spectrum
    between = "with their nonzero Laplacian eigenvalues from {:.6g} to {:.6g}"
    if spectrum is not None:
        said = "all undirected graphs of any size {}, switching among them, agents that join and leave"
        return said.format(between.format(*spectrum))
    if max(check_covered(network.matrices, _ANY)) != 1:
        return "this graph"
    if len(ends) > 2:
        return f"any one undirected graph {between.format(ends[0], ends[-1])}, fixed: {len(ends) - 1} segments, a P each"
    said = "all undirected graphs of any size {}, switching among them: one P"
    return said.format(between.format(ends[0], ends[-1]))


def least_witness(
    network: Network, gains: Gains, claim: Claim
) -> tuple[Float[np.ndarray, " s"], ModalWitness | None]:
    """Return segments, as fine as it pays where they may be, and the least sigma that the solver finds with them, or None."""
    modes, K = Modes(network.plant, gains.order, network.decay), gains.blocks[0]
    ends = segment_ends(network, check_covered(network.matrices, claim))
    return fine_witness(modes, K, claim, ends, halvings=0 if network.spectrum is not None else HALVINGS)


def _shortest(
    network: Network,
    gains: Gains,
    claim: Claim,
    ends: Float[np.ndarray, " s"],
    rho: float,
    inside: ModalWitness,
) -> ModalCertificate | None:
    """Return the witness rounded to the fewest digits with which it proves, or None."""
    for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1):
        shorter = (rounded_storage(P, digits) for P in inside.P)
        segments = tuple(Segment(float(b), P) for b, P in zip(ends[1:], shorter, strict=True))
        mu, *entries = (float(f"{one:.{digits}g}") for one in inside.mu)
        P_mean = rounded_storage(inside.P_mean, digits)
        trial = ModalCertificate(rho, float(ends[0]), segments, mu, P_mean, tuple(entries))
        if decide_modes(network.matrices, gains, claim, trial).positive:
            return trial
    return None


GRID = 33
"""Eigenvalues looked at of a spectrum that many graphs have."""


def eigenvalues_of(network: Network) -> Float[np.ndarray, " k"]:
    """Return the nonzero eigenvalues of L in doubles, or a grid of those that many graphs have."""
    if network.spectrum is not None:
        return np.geomspace(*network.spectrum, GRID)
    return _eigenvalues(network.graph, check_covered(network.matrices, _ANY))[1:]


def _eigenvalues(graph: Digraph, known: Vector) -> Float[np.ndarray, " N"]:
    root = np.sqrt(as_floats(known))
    symmetric = root[:, None] * graph.laplacian / root[None, :]
    return np.asarray(np.linalg.eigvalsh((symmetric + symmetric.T) / 2))


def spectrum_bounds(graph: Digraph, known: Vector) -> tuple[float, float]:
    """Return (lower, upper) a little outside lambda_2 and lambda_N."""
    values = _eigenvalues(graph, known)
    room = OUTSIDE * values[-1]
    return float(values[1] - room), float(values[-1] + room)
