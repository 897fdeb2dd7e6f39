"""The certificate inequality as a semidefinite program: the least rho for given gains, and a witness well
inside.

cvxpy states it and Clarabel solves it. What comes back is a candidate: `rounding.prove` rounds it and decides
it exactly.
"""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.channels import Inequality
from lockstep.check.continuous.inequality import Certificate, Claim, inequality
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.frequency_multipliers import MOST_ENTRIES, PAIR, least_by_frequencies, storage_at
from lockstep.lmi.analysis.strict_feasibility import strictly_feasible_point
from lockstep.lmi.shapes import GainBlocks, Multipliers

if TYPE_CHECKING:
    import cvxpy as cp

SOLVED = ("optimal", "optimal_inaccurate")
"""Statuses that come with numbers worth checking; neither is believed."""

REFUSED = ("infeasible", "infeasible_inaccurate")
"""Statuses with a proof, to the solver's accuracy, that there is nothing to find."""

UNITS = (1.0, 1e2, 1e4)
"""P grows like rho^2 as alpha comes near what the gains can carry; the solver wants numbers near one."""

ROOM = 1e-2
"""The part of the largest possible room s that a certificate keeps, for rounding."""

NO_WORSE = 1.001
"""A rho that is above the one known by more is the solver's failure."""

MOST_OF_GIVEN = 150
"""Entries, as for `MOST_ENTRIES`, above which the certificate of given gains does without P: with 234 it took 14 s of
processor, and a tenth of a second so, for a rho that was 4e-4 above."""

ACCEPTED = 2e-8
"""By how much, relative to its largest entry, a candidate may miss F <= 0 and still be worth a decision. Of forty that were
right none missed by more than 5e-9; of eight of stiff or slow loops, with a rho below any that there is, none by less than
4e-8."""


STEPS = 100
"""Of the solver: of 167 programs of seven designs all ended within 71, but one that took 200 and came to nothing."""


@dataclass(frozen=True)
class AffineF:
    """F for given gains, affine in the unknowns: F = J P Z + (J P Z)' + F_0 + sum_k w_k F_k.

    J = [I; 0], Z = [A_cl, E, E_G, 0, X], and w = (m, m_entries, t, rho^2) in this order, each 0 or above.
    """

    loop: Loop
    gains: GainBlocks
    claim: Claim

    @cached_property
    def stated(self) -> Inequality:
        """The inequality, whose first channel is the disturbance, whose second the nonlinearity."""
        return inequality(self.loop, self.claim)

    @property
    def pairs(self) -> int:
        """How many pair weights there are, those of alpha and of each entry; none without a nonlinearity."""
        return len(self.stated.channels[1].cone)

    @property
    def ways(self) -> int:
        """How many fragility multipliers t there are."""
        return len(self.stated.channels) - 2

    @cached_property
    def Z(self) -> Float[np.ndarray, "n_x n_F"]:
        """[A_cl, E, E_G, 0, X]."""
        return self.stated.flow(self.gains)

    @cached_property
    def constant(self) -> Float[np.ndarray, "n_F n_F"]:
        """F_0, which holds the weights R and Q."""
        return self.stated.constant(self.gains)

    @cached_property
    def slopes(self) -> Float[np.ndarray, "w n_F n_F"]:
        """F_k for each of (m, m_entries, t, rho^2)."""
        return np.roll(self.stated.slopes(self.gains), -1, axis=0)

    def multipliers(self, certificate: Certificate) -> Multipliers:
        """Return (m, m_entries, t, rho^2) of a certificate."""
        # A linear loop has no pair weights to look for, whatever its certificates have in their place.
        return np.array([*certificate.pair_weights[: self.pairs], *certificate.t, certificate.rho**2])

    def certificate(self, P: Float[np.ndarray, "n_x n_x"], w: Multipliers) -> Certificate:
        """Return the unknowns as a certificate."""
        m, m_entries = split_multipliers(self.loop, self.claim, np.maximum(w[: self.pairs], 0.0))
        t = np.maximum(w[self.pairs : self.pairs + self.ways], 0.0)
        return Certificate(float(np.sqrt(max(w[-1], 0.0))), (P + P.T) / 2, m, t, m_entries)


def eliminates_P(loop: Loop, most: int = MOST_ENTRIES) -> bool:
    """Tell whether P and the multipliers are too many to be unknowns of one program: see `frequency_multipliers`."""
    return loop.n_x * (loop.n_x + 1) // 2 + PAIR * len(loop.d.pairs()) > most


def least_rho(
    loop: Loop,
    gains: GainBlocks,
    claim: Claim,
    near: Certificate | None = None,
    *,
    any_rho: bool = False,
    most: int = MOST_OF_GIVEN,
) -> Certificate | None:
    """Minimise rho^2 over P > 0, m >= 0, t >= 0 with F <= 0; None where neither the solver nor the frequencies find any.

    near: multipliers and a rho of these gains, or of gains next to them: where they are right, the solver takes its units
    from a point inside.
    any_rho: whether it need not be the least, which takes a large loop most of its time.
    most: entries above which P is eliminated.
    """
    form = AffineF(loop, gains, claim)
    if eliminates_P(loop, most):
        return _by_frequencies(form, near, any_rho=any_rho)
    balanced = balance(form)
    if balanced is None:
        return None
    for unit in UNITS:
        found, refused = _least(balanced, unit)
        if found is not None or refused:
            break
    if found is None and not refused:  # of a stiff loop the solver may end with nothing
        found = _by_frequencies(form, near, any_rho=any_rho)
    if near is None or (found is not None and found.rho <= NO_WORSE * near.rho):
        return found
    inner = balance_inside(form, near)
    again = None if inner is None else _least(inner, 1.0)[0]
    return min((one for one in (found, again) if one is not None), key=lambda one: one.rho, default=None)


def _by_frequencies(form: AffineF, near: Certificate | None, *, any_rho: bool) -> Certificate | None:
    known = None if near is None else form.multipliers(near)
    at = least_by_frequencies(form.Z, form.constant, form.slopes, known, any_rho=any_rho)
    return None if at is None else form.certificate(*at)


def tight_certificate(
    loop: Loop,
    gains: GainBlocks,
    claim: Claim,
    rho: float,
    least: Certificate,
    near: Certificate | None = None,
    most: int = MOST_OF_GIVEN,
) -> Certificate | None:
    """For a given rho, return the smallest V that proves it with a little room for rounding; None if none is found.

    First s is maximised with F + s I <= 0, P >= s I; then the trace of P is minimised with a small part of that s kept.
    The smallest V fits these gains and hardly any others, so a file whose gains were changed does not pass by chance.

    Args:
        loop, gains, claim, rho: what is to be proved.
        least: the certificate of the least rho known; where P is eliminated, its multipliers stay.
        near, most: as for `least_rho`; without near in the units of a Lyapunov equation.
    """
    form = AffineF(loop, gains, claim)
    if eliminates_P(loop, most):
        at = storage_at(form.Z, form.constant, form.slopes, form.multipliers(replace(least, rho=rho)))
        return None if at is None else replace(form.certificate(*at), rho=rho)
    balanced = balance(form) if near is None else balance_inside(form, near)
    return None if balanced is None else _smallest(balanced, rho)


def _smallest(b: "Balanced", rho: float) -> Certificate | None:
    import cvxpy as cp

    n_x, n_F = b.Z.shape
    P, w, s = cp.Variable((n_x, n_x), symmetric=True), cp.Variable(len(b.norms)), cp.Variable()
    F = _expression(b, P, w, 1.0)
    conditions = [P >> s * np.eye(n_x), F + s * np.eye(n_F) << 0, w[-1] == rho**2 * b.norms[-1], s <= 1]
    conditions += [w[:-1] >= 0] if len(b.norms) > 1 else []
    solved = solve_sdp(cp.Problem(cp.Maximize(s), conditions))
    if not solved or s.value is None or s.value <= 0 or P.value is None:
        return None
    candidate = b.certificate(P.value, w.value, rho)
    room = ROOM * float(s.value)
    smallest = cp.Problem(cp.Minimize(cp.trace(P)), [*conditions, s == room])
    inside = solve_sdp(smallest) and float(np.linalg.eigvalsh(F.value)[-1]) <= -room / 2
    return b.certificate(P.value, w.value, rho) if inside else candidate


@dataclass(frozen=True)
class Balanced:
    """The inequality in coordinates where the solver meets numbers near one: P = L P^ L', F^ = D F D', w = w^
    / norms; F^ = J P^ Z + (J P^ Z)' + ...

    L is the Cholesky factor of the solution of P A_cl + A_cl' P = -diag(R, Q), so P^ = I is a good first
    guess however
    stiff the loop is; D = diag(L^-1, I / |L|, I).
    """

    form: AffineF
    L: Float[np.ndarray, "n_x n_x"]
    J: Float[np.ndarray, "n_F n_x"]
    Z: Float[np.ndarray, "n_x n_F"]
    constant: Float[np.ndarray, "n_F n_F"]
    slopes: Float[np.ndarray, "w n_F n_F"]
    norms: Multipliers

    def certificate(self, P: Float[np.ndarray, "n_x n_x"], w: Multipliers, rho: float) -> Certificate:
        """Return the unknowns, back in the coordinates of the loop, as a certificate for a given rho."""
        return replace(self.form.certificate(self.L @ P @ self.L.T, w / self.norms), rho=rho)


def balance(form: AffineF) -> Balanced | None:
    """Return the balanced inequality, or None where A_cl is not stable, so that no certificate exists."""
    from scipy.linalg import solve_continuous_lyapunov

    n_x, n_d = form.loop.n_x, form.stated.channels[0].E.shape[1]
    A_cl = form.Z[:, :n_x]
    if np.linalg.eigvals(A_cl).real.max() >= 0:
        return None
    try:
        with warnings.catch_warnings():
            # A pole within rounding of the axis: SciPy perturbs it and says so; the factor below then fails or serves.
            warnings.simplefilter("ignore", RuntimeWarning)
            P = solve_continuous_lyapunov(A_cl.T, -form.constant[:n_x, :n_x])
        L, D = np.linalg.cholesky((P + P.T) / 2), np.eye(len(form.constant))
        D[:n_x, :n_x] = np.linalg.inv(L)
        D[n_x : n_x + n_d, n_x : n_x + n_d] /= np.linalg.norm(L, 2)
        with np.errstate(all="ignore"):
            found = _balanced(form, L, D, np.linalg.norm(D @ form.slopes @ D.T, 2, axis=(1, 2)))
    except (np.linalg.LinAlgError, ValueError):
        return None
    overflows = not np.isfinite(np.concatenate([found.constant[None], found.slopes])).all()
    return None if overflows else found


def balance_inside(form: AffineF, near: Certificate) -> Balanced | None:
    """Return the inequality in the units of a point inside it: P^ = I, w^ = 1 and -1 on the diagonal of F^; None where
    multipliers near those given have none."""
    found = strictly_feasible_point(form.Z, form.constant, form.slopes, form.multipliers(near))
    if found is None:
        return None
    P, w, F = found
    return _balanced(form, np.linalg.cholesky(P), np.diag(1 / np.sqrt(-np.diag(F))), 1 / w)


def _balanced(
    form: AffineF, L: Float[np.ndarray, "n_x n_x"], D: Float[np.ndarray, "n_F n_F"], norms: Multipliers
) -> Balanced:
    J, slopes = D[:, : len(L)] @ L, D @ form.slopes @ D.T / norms[:, None, None]
    return Balanced(form, L, J, L.T @ form.Z @ D.T, D @ form.constant @ D.T, slopes, norms)


def _least(b: Balanced, unit: float) -> tuple[Certificate | None, bool]:
    """Minimise rho^2 with P, w in multiples of `unit`: F is homogeneous in (P, w, F_0).

    Return the certificate, or None and whether the solver shows that there is none, so that no unit would help.
    """
    import cvxpy as cp

    n_x = len(b.L)
    P, w = cp.Variable((n_x, n_x), symmetric=True), cp.Variable(len(b.norms))
    F = _expression(b, P, w, unit)
    conditions = [P >> 0, F << 0] + ([w[:-1] >= 0] if len(b.norms) > 1 else [])
    problem = cp.Problem(cp.Minimize(w[-1]), conditions)
    if not solve_sdp(problem) or P.value is None or w.value is None:
        return None, problem.status in REFUSED
    if float(np.linalg.eigvalsh(F.value)[-1]) > ACCEPTED * np.abs(F.value).max():
        return None, False
    rho = float(np.sqrt(max(unit * w.value[-1] / b.norms[-1], 0.0)))
    return b.certificate(unit * P.value, unit * w.value, rho), False


def _expression(b: Balanced, P: "cp.Variable", w: "cp.Variable", unit: float) -> "cp.Expression":
    import cvxpy as cp
    import scipy.sparse as sp

    n_F = b.Z.shape[1]
    half = sp.csr_array(b.J) @ P @ b.Z
    weighted = sp.csc_array(b.slopes.reshape(len(b.slopes), -1).T) @ w
    F = half + half.T + b.constant / unit + cp.reshape(weighted, (n_F, n_F), order="C")
    return (F + F.T) / 2


def split_multipliers(
    loop: Loop, claim: Claim, weights: Float[np.ndarray, " weights"]
) -> tuple[Float[np.ndarray, " pairs"], Float[np.ndarray, "entries pairs"]]:
    """Return m and m_entries from one vector of them, which is empty where there is no nonlinearity: then m is 0."""
    pairs = len(loop.d.pairs())
    m = weights[:pairs] if len(weights) else np.zeros(pairs)
    return m, weights[pairs:].reshape(len(claim.entries), pairs)


def solve_sdp(problem: "cp.Problem", *, decompose: bool = True) -> bool:
    """Solve with Clarabel; its warnings about accuracy are dropped because nothing here relies on it.

    Args:
        problem: what to solve.
        decompose: whether large sparse cones are split into cliques; the merging of cliques was seen not to end on
            (19) for agents of one state, which are too small to need it.
    """
    import cvxpy as cp

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.CLARABEL, chordal_decomposition_enable=decompose, max_iter=STEPS)
        except cp.SolverError:
            return False
    return problem.status in SOLVED
