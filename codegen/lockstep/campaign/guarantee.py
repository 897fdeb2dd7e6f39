"""What a campaign's runs are held against, proved anew: rho, and V of the initial disagreement.

For the continuous controllers the design's certificate, in exact arithmetic; for the sampled ones that of the very numbers
in the emitted C, in balls. What the files say of themselves does not count.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.errors import NotCertified, ProblemError, demand
from lockstep.check.numbers import as_floats
from lockstep.check.sampled.inequality import Witness
from lockstep.check.system.disagreement import disagreement
from lockstep.codegen.sampled_design import certify_files
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored

Controllers = Literal["sampled", "continuous"]


@dataclass(frozen=True, eq=False)
class Guarantee:
    """rho and, in the coordinates T (N-1, N), the matrix P of V(x_d) = x_d' P x_d; None where V is not at hand.

    limit: of what an input may be where nothing clips it: rho says nothing of runs beyond.
    """

    rho: float
    T: Float[np.ndarray, "N-1 N"]
    P: Float[np.ndarray, "n_d n_d"] | None
    limit: float = np.inf

    def stored(self, x: Float[np.ndarray, "runs states"]) -> Float[np.ndarray, " runs"]:
        """Return V of initial states with the controllers at rest; NaN where it is unknown and not zero."""
        N = self.T.shape[1]
        x_d = np.einsum("ij,rjk->rik", self.T, x.reshape(len(x), N, -1)).reshape(len(x), -1)
        if self.P is None:
            return np.where((x_d == 0).all(axis=1), 0.0, np.nan)
        return np.asarray(np.einsum("ri,ij,rj->r", x_d, self.P, x_d))


def guarantee_of(stored: Stored, files: Mapping[str, str] | None, kind: Controllers) -> Guarantee:
    """Prove a design's rho and return it.

    Args:
        stored: the design; its witnesses are tried first.
        files: the emitted folder, relative path -> text, for sampled controllers.
        kind: of which controllers.

    Raises:
        NotCertified: there is no proof, and why.
        ProblemError: rho is a gain from no state; no emitted C, for sampled controllers.
    """
    problem = stored.problem
    states = problem.performance.states
    found, some = "rho is a gain from the noise of outputs alone", "a scale above 0 for one state at least"
    remedy = "a campaign disturbs states: design with such a scale, or leave `states` out"
    demand(not len(states) or bool(states.any()), found, "[design.disturbances], --campaign", some, remedy)
    T = as_floats(disagreement(problem.graph(), problem.design.coordinates).T)
    n_d = len(T) * problem.agent().n
    if kind == "continuous":
        verdict = certify(stored)
        if not verdict.certified or stored.proofs.certificate is None:
            raise NotCertified(f"there is no certified rho to hold a campaign against: {verdict.reason}")
        certificate = stored.proofs.certificate
        P = certificate.P[:n_d, :n_d] if isinstance(certificate, Certificate) else None
        return Guarantee(certificate.rho, T, P, float(np.abs(problem.sides).min()))
    if files is None:
        raise ProblemError(
            "no emitted C", where="campaign", expected="that of the design, for sampled controllers"
        )
    decided, rho = certify_files(files, stored), stored.claims.sampled.rho
    witness = stored.proofs.sampled_rho
    if not decided.proves("sampled_rho") or rho is None or witness is None:
        why = "the design claims none beside their certificate" if decided.ok else decided.reason
        raise NotCertified(
            f"there is no proved rho of the sampled controllers to hold a campaign against: {why};"
            " hold one of the continuous controllers against theirs (`--controllers continuous`), or shorten [controller]"
            " period"
        )
    return Guarantee(rho, T, witness.P[:n_d, :n_d] if isinstance(witness, Witness) else None)
