"""Controllability and observability by the Popov-Belevitch-Hautus test, with its distance to failing.

(A, B) is controllable if [A - s I, B] has rank n for every complex s, stabilisable if it has for every s with
Re s >= 0; (A, C) is observable or detectable if (A', C') is controllable or stabilisable. The paper assumes
(A, B_i) controllable and (A, C) observable under (2).

The least over s of the smallest singular value of [A - s I, B] is the distance to the nearest uncontrollable
pair (Eising 1984). Whether the pair has lost a mode is asked near every eigenvalue of A: at the computed
eigenvalue alone the value is wrong by as much as the eigenvalue is, and a double eigenvalue is only known to
the square root of the rounding error. The distance itself is looked for on a grid around all eigenvalues: it
is the least value found, so an upper bound.
"""

from dataclasses import astuple, dataclass

import numpy as np
from jaxtyping import Float

TINY = 1e-100
"""A norm of A that B is not counted in: B over a subnormal number overflows."""

DESCENTS = 4
"""Points of the grid that the search for the distance goes on from: the lowest ones."""


@dataclass(frozen=True)
class Controllability:
    """Whether inputs reach every mode: figures of the pair (A, B)."""

    controllable: bool
    stabilisable: bool
    margin: float
    """Smallest singular value found of [A - s I, B], in the pair's own units: the distance to the nearest
    uncontrollable pair is this at most."""
    eigenvalue: complex
    """The s of that smallest value: the mode that is lost, or that such a pair has lost."""
    unstable_eigenvalue: complex | None
    """A lost mode with Re s >= 0, where the pair is not even stabilisable."""
    relative_margin: float
    """The same after balancing and scaling A and B to norm one: what is compared with `tolerance`."""
    tolerance: float


@dataclass(frozen=True)
class Observability:
    """Whether outputs show every mode: the same figures for (A', C')."""

    observable: bool
    detectable: bool
    margin: float
    eigenvalue: complex
    unstable_eigenvalue: complex | None
    relative_margin: float
    tolerance: float


def controllability(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]) -> Controllability:
    """Test the pair (A, B).

    >>> check = controllability(np.diag([-1.0, 2.0]), np.array([[0.0], [1.0]]))
    >>> check.controllable, check.stabilisable, check.eigenvalue
    (False, True, (-1+0j))
    """
    a, b, size, tolerance = _balanced(A, B)
    modes = _modes(a, b)
    nearest = min(modes, key=lambda mode: (mode[1], -mode[0].real, -mode[0].imag))
    lost = [s for s, value in modes if value <= tolerance]
    # A lost mode that rounding cannot tell from one on the imaginary axis counts as not decaying.
    unstable = [s for s in lost if s.real >= 0 or _least(a, b, complex(0.0, s.imag)) <= tolerance]
    s, margin = _distance(A, B) if not lost else (size * nearest[0], _least(A, B, size * nearest[0]))
    return Controllability(
        not lost,
        not unstable,
        margin,
        _tidy(s, size),
        _tidy(size * unstable[0], size) if unstable else None,
        nearest[1],
        tolerance,
    )


def observability(A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "q n"]) -> Observability:
    """Test the pair (A, C).

    >>> observability(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 1.0]])).detectable
    False
    """
    return Observability(*astuple(controllability(A.T, C.T)))


def lost_modes(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]) -> list[complex]:
    """Return the modes of A, Im s >= 0, that no input moves: [A - s I, B] has lost rank there.

    >>> lost_modes(np.diag([-1.0, 2.0]), np.array([[0.0], [1.0]]))
    [(-1+0j)]
    """
    a, b, size, tolerance = _balanced(A, B)
    return [_tidy(size * s, size) for s, value in _modes(a, b) if value <= tolerance]


def _balanced(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], float, float]:
    """Return the pair, balanced and of norm one, the norm of A and below what a singular value of it counts as 0."""
    from scipy.linalg import matrix_balance

    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    size = float(np.linalg.norm(balanced, 2)) or 1.0
    # Rounding of an n x n singular value is a few n eps of the pair's norm, which is now 1; 100 leaves
    # room for decimals in a file whose exact values would cancel.
    return _unit(balanced), _unit(B / scale[:, None]), size, 100 * len(A) * float(np.finfo(float).eps)


def _distance(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]) -> tuple[complex, float]:
    """Return (s, value), the least value over s that is found from a grid and the eigenvalues.

    Half of the plane is enough, the value at the conjugate of s is the same.
    """
    norm = float(np.linalg.norm(A, 2))
    size = norm if norm > TINY else 1.0
    a, b = A / size, B / size
    own = np.linalg.eigvals(a)
    real = np.linspace(own.real.min() - 0.1, own.real.max() + 0.1, 31)
    imaginary = np.linspace(0.0, np.abs(own.imag).max() + 0.1, 21)
    grid = (real[:, None] + 1j * imaginary).ravel()
    starts = np.concatenate([own[own.imag >= 0], own.real, grid])
    pencils = np.concatenate(
        [a - starts[:, None, None] * np.eye(len(a)), np.broadcast_to(b, (len(starts), *b.shape))], axis=2
    )
    values = np.linalg.svd(pencils, compute_uv=False)[:, -1]
    # A smooth minimum is flat: s to 1e-7 gives the value to 1e-14.
    found = [_descend(a, b, complex(s), 1e-7) for s in starts[np.argsort(values, kind="stable")[:DESCENTS]]]
    s, value = min(found, key=lambda mode: mode[1])
    return size * s, size * value


def _modes(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]) -> list[tuple[complex, float]]:
    """Return (s, smallest singular value of [A - s I, B]) near each eigenvalue with Im s >= 0, for |A| = 1.

    The value changes by at most |ds|, so a mode that is far from lost at the computed eigenvalue is not lost
    near it.
    """
    values = [(complex(s), _least(A, B, complex(s))) for s in np.linalg.eigvals(A) if s.imag >= 0]
    least = min(value for _, value in values)
    return [_descend(A, B, s) if value <= max(1e-2, least) else (s, value) for s, value in values]


def _unit(matrix: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    size = float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0
    return matrix / size if size else matrix


def _least(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], s: complex) -> float:
    """Return the smallest singular value of [A - s I, B]."""
    return float(np.linalg.svd(np.hstack([A - s * np.eye(A.shape[0]), B]), compute_uv=False)[-1])


def _descend(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], start: complex, accuracy: float = 1e-15
) -> tuple[complex, float]:
    """Return (s, value) at a local minimum over s of the smallest singular value of [A - s I, B], from
    `start`.

    The minimum has no derivative where the value is 0, hence the simplex search; a real start stays real if
    that is best.
    """
    from scipy.optimize import minimize

    def value(s: Float[np.ndarray, "2"]) -> float:
        return _least(A, B, complex(s[0], s[1]))

    corner = np.array([start.real, start.imag])
    simplex = corner + 1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"xatol": accuracy, "fatol": accuracy / 100, "maxiter": 400, "initial_simplex": simplex}
    found = minimize(value, corner, method="Nelder-Mead", options=options)
    # A real s that is as good to rounding is the mode: the search leaves small imaginary parts behind.
    ends = [complex(found.x[0]), complex(*found.x), start]
    values = [_least(A, B, s) for s in ends]
    close = min(values) * (1 + 1e-9) + float(np.finfo(float).eps)
    return next((s, v) for s, v in zip(ends, values, strict=True) if v <= close)


def _tidy(s: complex, size: float) -> complex:
    """Drop what is rounding in an eigenvalue, for messages."""
    small = 1e-10 * size
    return complex(0.0 if abs(s.real) < small else s.real, 0.0 if abs(s.imag) < small else s.imag)
