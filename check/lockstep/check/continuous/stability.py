"""Whether a matrix is stable: decided exactly, from its characteristic polynomial by Routh's array.

Re lambda < 0 for every eigenvalue lambda of A exactly if the first column of Routh's array of det(s I - A) is positive
(Gantmacher, The Theory of Matrices, volume 2, chapter XV). |lambda| < 1 for every eigenvalue of A exactly if A - I is
regular and Re < 0 for those of (A + I)(A - I)^-1, s = (z + 1)/(z - 1).
"""

from flint import fmpq_mat

from lockstep.check.numbers import Matrix, exactly, eye, inverse


def is_stable(A: Matrix) -> bool:
    """Decide Re lambda < 0 for every eigenvalue of A (n, n), in rationals or in the rationals that doubles are.

    >>> import numpy as np
    >>> is_stable(np.array([[0.0, 1.0], [-1.0, -0.001]])), is_stable(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    (True, False)
    """
    if not len(A):
        return True
    falling = fmpq_mat(exactly(A).tolist()).charpoly().coeffs()[::-1]
    first, second = falling[::2], falling[1::2]
    for _ in range(len(A)):
        if not second or not second[0] > 0:
            return False
        ratio = first[0] / second[0]
        below = [*second, *[ratio * 0] * (len(first) - len(second))]
        first, second = second, [first[k + 1] - ratio * below[k + 1] for k in range(len(first) - 1)]
    return True


def is_stable_step(A: Matrix) -> bool:
    """Decide |lambda| < 1 for every eigenvalue of A (n, n).

    >>> import numpy as np
    >>> is_stable_step(np.array([[0.0, 1.0], [-0.999, 0.0]])), is_stable_step(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    (True, False)
    """
    exact = exactly(A)
    one = eye(len(exact), exact)
    try:
        return is_stable((exact + one) @ inverse(exact - one)) if len(exact) else True
    except ZeroDivisionError:
        return False
