"""The weights R and Q of the paper as matrices."""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError

Weight = float | tuple[float, ...] | tuple[tuple[float, ...], ...]


def weight_matrix(weight: Weight, size: int, *, where: str, per: str) -> Float[np.ndarray, "size size"]:
    """Return a weight as a symmetric positive definite matrix.

    Args:
        weight: w for w I, a list for a diagonal matrix, or a matrix by rows.
        size: the number of rows.
        where: the place in the file, for messages.
        per: what there is one number of, such as "state".

    Raises:
        ProblemError: a wrong shape, an entry that is not finite, not symmetric, or not positive definite.

    >>> weight_matrix((1.0, 4.0), 2, where="[design.weights] state", per="state")
    array([[1., 0.],
           [0., 4.]])
    """
    square = f"{size} x {size}"
    expected = f"a number above 0, {size} of them (one per {per}), or a symmetric {square} matrix"
    if isinstance(weight, tuple) and len({len(row) if isinstance(row, tuple) else 0 for row in weight}) > 1:
        raise ProblemError("rows of different lengths", where=where, expected=expected)
    given = np.asarray(weight, dtype=float)
    matrix = (
        np.diag(np.broadcast_to(given, size))
        if given.ndim == 0
        else np.diag(given)
        if given.ndim == 1
        else given
    )
    if matrix.shape != (size, size):
        shape = (
            f"{given.shape[0]} numbers"
            if given.ndim == 1
            else f"a {' x '.join(map(str, given.shape))} matrix"
        )
        raise ProblemError(f"{shape} for {size} {per}s", where=where, expected=expected)
    if not np.isfinite(matrix).all():
        raise ProblemError("an entry is not a finite number", where=where, expected=expected)
    if (matrix != matrix.T).any():
        i, j = np.argwhere(matrix != matrix.T)[0]
        raise ProblemError(
            f"row {i + 1}, column {j + 1} is {matrix[i, j]}, but row {j + 1}, column {i + 1} is "
            f"{matrix[j, i]}",
            where=where,
            expected="a symmetric matrix",
        )
    least = float(np.linalg.eigvalsh(matrix)[0]) if size else 1.0
    if least <= 0:
        raise ProblemError(
            f"its smallest eigenvalue is {least:.6g}", where=where, expected="a positive definite weight"
        )
    return np.array(matrix)
