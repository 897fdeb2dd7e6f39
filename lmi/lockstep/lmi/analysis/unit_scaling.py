"""A loop in units in which its numbers are near one: time, states, inputs, outputs and the nonlinearity by powers of
two.

With x = X^-1 x^, t = tau t^, u = S_u u^, y^ = S_y y, v^ = g v, phi^ = (g / a) phi and xi^ = e xi, each scale a power of two,

    A^ = tau X A X^-1,   B^ = tau X B S_u,   C^ = S_y C X^-1,   G^ = tau X G a / g,   H^ = g H X^-1,   E^ = tau X E / e,

and alpha^ = alpha / a near one: a phi of 1e-12 whose G is 1e12 is the same agent as one whose both are one.

The scales are `lockstep.model.loop_transformation.natural_units`. A power of two changes no bit of a fraction, so the scaled
loop is the same loop. The gains stay in the units of the file, where their limit is; `Units.gains` is the size
of theirs.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.system.loop import Loop, Plant
from lockstep.model.loop_transformation.natural_units import natural_units


@dataclass(frozen=True)
class Units:
    """Units of a search beside those of the file.

    gains: (n_C + m, n_C + q), the size that an entry of each agent's gains has where it is one in the units of the
    search; state: (n_x,), X;  time: tau;  multiplier: (g / a)^2, by which pair weights grow;  cost: what R and Q were
    divided by; disturbance: e.
    """

    gains: Float[np.ndarray, "k l"]
    state: Float[np.ndarray, " n_x"]
    time: float
    multiplier: float
    cost: float
    disturbance: float

    @property
    def pair_weight(self) -> float:
        """What a pair weight of the scaled loop is multiplied by."""
        return self.cost * self.multiplier

    @property
    def rho(self) -> float:
        """What a rho of the scaled loop is multiplied by."""
        return float(np.sqrt(self.cost)) * self.disturbance

    def certificate(self, found: Certificate) -> Certificate:
        """Return a certificate of the scaled loop as one of the loop of the file."""
        weights = self.pair_weight
        return Certificate(
            self.rho * found.rho,
            self.cost * self.time * self.state[:, None] * found.P * self.state,
            weights * found.m,
            self.cost * found.t,
            weights * found.m_entries,
        )

    def scaled(self, found: Certificate) -> Certificate:
        """Return a certificate of the loop of the file as one of the scaled loop."""
        weights = self.pair_weight
        return Certificate(
            found.rho / self.rho,
            found.P / (self.cost * self.time * np.outer(self.state, self.state)),
            found.m / weights,
            found.t / self.cost,
            found.m_entries / weights,
        )


def scaled(loop: Loop, claim: Claim) -> tuple[Loop, Claim, Units]:
    """Return the loop and the claim in units of the search, for gains in the units of the file.

    Args:
        loop: in doubles.
        claim: alpha, R, Q and delta.
    """
    plant, order, N = loop.plant, loop.order, len(loop.U)
    S, inputs, outputs, time, g = natural_units(plant, claim.alpha, claim.R)
    S_C = 2.0 ** np.round(np.log2(np.maximum(np.diag(claim.Q), 1e-300)) / 2) if order else np.ones(0)
    state = np.concatenate([np.tile(S, loop.d.N - 1), np.tile(S_C, N)])
    a = 2.0 ** round(np.log2(claim.alpha)) if claim.alpha else 1.0
    d = claim.states if claim.states.any() else np.ones(len(S))
    e = float(2.0 ** np.round(np.log2((time * S * d)[d > 0]).mean()))
    R, Q = claim.R / np.outer(S, S), claim.Q / np.outer(S_C, S_C)
    cost = float(4.0 ** np.round(np.log2(max(np.diag(R).max(initial=0.0), np.diag(Q).max(initial=0.0))) / 2))
    new = replace(
        loop,
        plant=plant_in_units(plant, S, time, g, a),
        A_0=time * state[:, None] * loop.A_0 / state,
        U=tuple(time * state[:, None] * U for U in loop.U),
        Y=tuple(Y / state for Y in loop.Y),
        E=time * state[:, None] * loop.E / e,
    )
    gains = np.outer(np.concatenate([1 / (time * S_C), inputs]), np.concatenate([S_C, outputs]))
    W, noise, claim = claim.W / cost, claim.outputs / e, claim_at(claim, alpha=claim.alpha / a)
    claim = replace(claim, R=R / cost, Q=Q / cost, W=W, outputs=noise)
    return new, claim, Units(gains, state, time, (g / a) ** 2, cost, e)


def claim_at(claim: Claim, *, alpha: float | None = None, fraction_of_delta: float = 1.0) -> Claim:
    """Return an easier or harder claim, for continuation: the entries are scaled as alpha is."""
    alpha = claim.alpha if alpha is None else alpha
    part = alpha / claim.alpha if claim.alpha else 1.0
    entries = tuple(replace(one, bound=part * one.bound) for one in claim.entries)
    return replace(claim, alpha=alpha, delta=claim.delta * fraction_of_delta, entries=entries)


def plant_in_units(
    plant: Plant,
    X: Float[np.ndarray, " n"],
    time: float,
    g: float,
    a: float,
    S_u: Float[np.ndarray, " m"] | float = 1.0,
    S_y: Float[np.ndarray, " q"] | float = 1.0,
) -> Plant:
    """Return A^, B^, C^, G^ and H^."""
    rows, S_y = time * X[:, None], np.asarray(S_y)
    return Plant(
        A=rows * plant.A / X,
        B=tuple(rows * B * S_u for B in plant.B),
        C=S_y[..., None] * plant.C / X,
        G=rows * plant.G * (a / g),
        H=g * plant.H / X,
    )
