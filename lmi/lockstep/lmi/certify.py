"""The independent checker: from a design file to a verdict, by symbolic algebra and exact arithmetic alone.

It imports no solver and believes nothing but the problem: the agent's matrices are derived again from its
equations, alpha is proved again in interval arithmetic, the inequality is built again over the rationals, and
an exact decision is made. What a reader has to trust is this file, `decide`, `inequality`, `definite`, and
the model layer under them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lockstep.lmi.decide import decide
from lockstep.lmi.definite import Definiteness
from lockstep.lmi.document import Stored
from lockstep.lmi.inequality import Claim
from lockstep.model.assembly import bound_of, network_of
from lockstep.model.bound import Bound


@dataclass(frozen=True)
class Verdict:
    """Whether a design is certified, and if not, which claim fails and by how much.

    bound: of the nonlinearity, decided for the alpha of the file;  definiteness: of P and -F;  reason: in
    plain words.
    """

    certified: bool
    reason: str
    bound: Bound | None
    definiteness: Definiteness | None
    margin: float

    def figures(self) -> dict[str, Any]:
        """Return the figures behind a refusal, as JSON types."""
        if self.definiteness is not None and not self.definiteness.positive:
            vector = self.definiteness.vector
            return {
                "margin": self.margin,
                "value": self.definiteness.value,
                "vector": None if vector is None else [float(x) for x in vector],
            }
        if self.bound is not None and not self.bound.proved:
            witness = self.bound.witness
            return {
                "bound_lower": self.bound.lower,
                "witness": None
                if witness is None
                else {"v": list(witness.v), "t": witness.t, "slope": witness.slope},
            }
        return {"margin": self.margin}


def certify(stored: Stored) -> Verdict:
    """Decide whether the stored gains have the properties the file claims, from the file's problem alone."""
    problem, c = stored.problem, stored.certificate
    if c is None:
        return Verdict(False, "the file holds gains without a certificate", None, None, float("nan"))
    problem.validate()
    if c.rho <= 0 or stored.alpha < 0:
        return Verdict(
            False,
            f"the file claims rho = {c.rho:g} and alpha = {stored.alpha:g}: rho must be positive and"
            " alpha not negative",
            None,
            None,
            float("nan"),
        )
    bound = bound_of(problem.agent(), alpha=stored.alpha)
    if not bound.proved:
        said = "is refuted" if bound.refuted else "is not proved"
        return Verdict(
            False, f"alpha = {stored.alpha:.12g} {said}: {bound.reason}", bound, None, float("nan")
        )
    network = network_of(problem, bound)
    delta = np.tile([stored.fragility[letter] for letter in "ABCD"], (network.N, 1))
    claim = Claim(
        stored.alpha, problem.state_weight(problem.agent().n), problem.controller_weight(problem.order), delta
    )
    answer = decide(network.loop(problem.order, exact_arithmetic=True), stored.gains.blocks, claim, c)
    if not answer.positive:
        return Verdict(
            False,
            f"the inequality does not hold: z' M z = {answer.value:.6g} <= 0 for a vector z of length 1"
            f" ({answer.method})",
            bound,
            answer,
            answer.margin,
        )
    return Verdict(True, f"P > 0 and F < 0, decided exactly ({answer.method})", bound, answer, answer.margin)
