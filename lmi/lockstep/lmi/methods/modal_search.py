"""Identical gains for all modes: from random ones down the smoothed norm of the modes at the ends of the segments.

`search.modes` does the descents; here their gains get a witness of the modes' certificate, on segments as fine as they need.
What comes out is a set of gains; `modal.prove_modes` certifies them or does not.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.lmi.analysis.unit_scaling import claim_at
from lockstep.lmi.methods.modal_witness import ModalWitness, fine_witness
from lockstep.lmi.search.common_gains import ModalSearch

FRACTIONS = (0.3, 0.1, 0.03, 0.01, 1e-3)
"""Parts of alpha tried for gains that do not carry all of it."""

DRAWS = 4
"""Random gains per start."""


@dataclass(frozen=True)
class ModalCandidate:
    """Gains with a witness for the full alpha, or None and the part of alpha that was reached."""

    K: Float[np.ndarray, "a b"] | None
    witness: ModalWitness | None
    fraction: float

    @property
    def sigma(self) -> float:
        """The sigma reached; infinite without a witness."""
        return np.inf if self.witness is None else self.witness.sigma


def from_start(search: ModalSearch, seed: int, index: int) -> ModalCandidate:
    """Run one start: draw gains, make them stable, lower rho, and take the best of those that have a witness.

    The same arguments, the same outcome.
    """
    generator = np.random.default_rng([seed, index])
    stable = (search.stable(generator) for _ in range(DRAWS))
    ends = sorted((search.down(K) for K in stable if K is not None), key=lambda at: (at.rho, at.gain))
    for at in ends:
        found = fine_witness(search.modes, at.K[0], search.claim, search.ends)[1]
        if found is not None:
            return ModalCandidate(at.K[0], found, 1.0)
    parts = (part for at in ends[:1] for part in FRACTIONS if _carries(search, at.K[0], part))
    return ModalCandidate(None, None, next(parts, 0.0))


def _carries(search: ModalSearch, K: Float[np.ndarray, "a b"], part: float) -> bool:
    claim = claim_at(search.claim, alpha=part * search.claim.alpha)
    return fine_witness(search.modes, K, claim, search.ends)[1] is not None


def drawn(search: ModalSearch, seed: int, index: int) -> list[Float[np.ndarray, "a b"]]:
    """Return gains of one start that are stable at the ends, taken down the smoothed norm of these modes."""
    generator = np.random.default_rng([seed, index])
    stable = (search.stable(generator) for _ in range(DRAWS))
    return [search.down(K, far=False).K[0] for K in stable if K is not None]
