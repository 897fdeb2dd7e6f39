"""Orthonormal coordinates of the disagreement, of whatever coordinates x_d has."""

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import as_floats
from lockstep.check.system.disagreement import Disagreement


def orthonormal_factor(d: Disagreement) -> Float[np.ndarray, "k k"]:
    """Return F with F'F = S: F x_d are orthonormal coordinates when S = (T T')^-1."""
    return np.linalg.cholesky(as_floats(d.S)).T
