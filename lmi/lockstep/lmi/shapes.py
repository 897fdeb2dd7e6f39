"""Arrays that many searches pass on, by what they hold; all others stand as shapes where they are used."""

import numpy as np
from jaxtyping import Float

GainBlocks = Float[np.ndarray, "N k l"]
"""K: [A B; C D] of every agent's controller, k = n_C + m rows and l = n_C + q columns."""

PairWeights = Float[np.ndarray, " pairs"]
"""m: a weight for each pair of agents, of the multiplier of the nonlinearity."""

Multipliers = Float[np.ndarray, " w"]
"""w: of all sectors and gain errors, and of rho where it is one more."""

GainLimit = Float[np.ndarray, "k l"] | float
"""L of |K_i / L| <= 1, entry by entry and in the spectral norm: one number for all entries, or one for each."""

Vector = Float[np.ndarray, " x"]
"""x: the unknowns of a search."""
