"""Steps with known answers, which the C repeats at start-up: inputs chosen so that other arithmetic shows.

Every step is computed as written, and by `VARIATIONS`: contracted, in another order, flushed to zero, rounded otherwise.
Of many candidates the one is taken in which most entries of (x+, u) differ under most variations. What follows
from the specification alone is the same on every machine: no random generator, and no library's sums.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from lockstep.check.c_source.kernel import Shape
from lockstep.check.c_source.reader import ANSWERS

SCALE = 2.0**100
"""What the answers to the tiny step are multiplied by: no longer near zero, they tell from a zero they were flushed to."""

_CANDIDATES = 256
_BIG = 20
"""Powers of two that a product of the largest gains and an input may reach: far from overflow in either type."""

_HALVINGS = 200
"""More than any limit and gain need."""

_NO_LIMITS = np.zeros((0, 2))

Pair = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class KnownAnswers:
    """What the self-check is given, and what it must find.

    given: rows of q inputs: a tiny r, then y and below it the neighbours', each row serving as many steps as it can.
    answers: the state x and the output u after each step, a row of nc + m for each; the first times `SCALE`, exactly.
    sensitive: names of the variations that change a bit of them.
    """

    given: np.ndarray
    answers: np.ndarray
    sensitive: tuple[str, ...]


@dataclass(frozen=True)
class Variation:
    """One way to compute: the rounding of sums and products, and the order of a sum of products."""

    add: Callable[[np.ndarray, np.ndarray], np.ndarray]
    multiply: Callable[[np.ndarray, np.ndarray], np.ndarray]
    dot: Callable[["Variation", Sequence[Pair]], np.ndarray]

    def total(self, terms: Sequence[Pair]) -> np.ndarray:
        """Return the sum of the products."""
        return self.dot(self, terms)


def known_answers(
    shape: Shape,
    table: np.ndarray,
    weights: np.ndarray,
    skip: bool,
    seed: str,
    limits: np.ndarray = _NO_LIMITS,
) -> KnownAnswers:
    """Choose inputs for the self-check of one agent, and compute its answers.

    Args:
        shape: nc, q, m, nn.
        table: [A B; C D] in the target type;  weights: a_j.
        skip: whether terms with a zero coefficient are left out.
        seed: text that the candidates are drawn from.
        limits: (m, 2), where u is clipped, if it is: no answer is, so that all its bits are compared.
    """
    given = _candidates(shape, table, weights, seed)
    with np.errstate(all="ignore"):
        run = partial(_run, shape, table, weights, skip, given)
        exact = run(_AS_WRITTEN)
        for _ in range(_HALVINGS):
            if _within(exact, shape, limits):
                break
            given[1:] /= 2
            exact = run(_AS_WRITTEN)
        scaled = exact[0] * exact.dtype.type(SCALE)
        fits = np.isfinite(exact).all(axis=(0, 1)) & np.isfinite(scaled).all(axis=0)
        shown = {name: _bits(run(v, exact)) != _bits(exact) for name, v in VARIATIONS.items()}
        count = sum(differs.any(axis=0).sum(axis=0) for differs in shown.values())
    best = int(np.argmax(np.where(fits, count, -1)))
    names = tuple(name for name, differs in shown.items() if differs[:, :, best].any())
    answers = exact[:, :, best]
    answers[0] *= answers.dtype.type(SCALE)
    return KnownAnswers(given[:, :, best], answers, names)


def _within(answers: np.ndarray, shape: Shape, limits: np.ndarray) -> bool:
    """Tell whether no u of any candidate is clipped."""
    u = np.abs(answers[:, shape.order :]).max(axis=(0, 2))
    return not len(limits) or bool((u <= np.abs(limits).min(axis=1)).all())


def _candidates(shape: Shape, table: np.ndarray, weights: np.ndarray, seed: str) -> np.ndarray:
    """Return rows x q x candidates of full-length numbers: row 0 near the smallest normal number, the others near 1."""
    limits = np.finfo(table.dtype)
    rows = ANSWERS + shape.neighbours
    count = rows * shape.outputs * _CANDIDATES
    stream = hashlib.shake_256(seed.encode()).digest(8 * count)
    integers = np.frombuffer(stream, "<u8").reshape(rows, shape.outputs, _CANDIDATES)
    # The sign, two bits of exponent, and as many bits as the type holds below the leading one.
    bits = limits.nmant
    fraction = 1 + (integers >> np.uint64(64 - bits)).astype(np.float64) / 2.0**bits
    sign = np.where(integers & np.uint64(1), -1.0, 1.0)
    values = sign * fraction * 2.0 ** -((integers >> np.uint64(1)) & np.uint64(3)).astype(np.float64)
    gain = float(np.abs(table).max(initial=1.0)) * float(np.abs(weights).max(initial=1.0))
    values[1:] *= 2.0 ** -max(0, int(np.frexp(gain)[1]) - _BIG)
    values[0] *= 2.0 ** (limits.minexp + 8.0 - np.arange(_CANDIDATES) % 24)
    return values.astype(table.dtype)


def _run(
    shape: Shape,
    table: np.ndarray,
    weights: np.ndarray,
    skip: bool,
    given: np.ndarray,
    v: Variation,
    exact: np.ndarray | None = None,
) -> np.ndarray:
    """Return (x+, u) after each step, answers x (nc + m) x candidates; each starts from the exact state before it."""
    found = np.zeros((ANSWERS, len(table), given.shape[2]), table.dtype)
    for k in range(ANSWERS):
        x = (found if exact is None else exact)[k - 1, : shape.order] if k else found[0, : shape.order] * 0
        y = given[k]
        r = y
        if k and shape.neighbours:
            r = _relative(v, y, given[k + 1 : k + 1 + shape.neighbours], weights)
        z = np.concatenate([x, r])
        for i, row in enumerate(table):
            terms = [
                (np.broadcast_to(a, s.shape), s) for a, s in zip(row, z, strict=True) if a != 0 or not skip
            ]
            if not skip:
                terms.insert(0, (np.zeros_like(z[0]), np.zeros_like(z[0])))  # the loop starts from +0
            found[k, i] = v.total(terms) if terms else 0
    return found


def _relative(v: Variation, y: np.ndarray, heard: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return r = a_1 (y - y_1) + a_2 (y - y_2) + ..."""
    differences = [v.add(y, -one) for one in heard]
    terms = [(np.broadcast_to(a, y.shape), d) for a, d in zip(weights, differences, strict=True)]
    nothing = np.zeros_like(y)
    return v.total([(nothing, nothing), *terms])


def _bits(values: np.ndarray) -> np.ndarray:
    return values.view(np.uint32 if values.dtype == np.float32 else np.uint64)


def _sum(a: np.ndarray, b: np.ndarray) -> Pair:
    """Return a + b rounded, and the error (Knuth's two-sum: Higham 2002, section 4.3)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _product(a: np.ndarray, b: np.ndarray) -> Pair:
    """Return a b rounded, and the error (Dekker 1971), where nothing underflows."""
    p = a * b
    factor = p.dtype.type(2.0 ** (12 if p.dtype == np.float32 else 27) + 1)

    def split(c: np.ndarray) -> Pair:
        high = c * factor - (c * factor - c)
        return high, c - high

    (ah, al), (bh, bl) = split(a), split(b)
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def _fused(total: np.ndarray, factors: Pair) -> np.ndarray:
    """Return the total plus a product, rounded once, but for ties."""
    p, e = _product(*factors)
    s, f = _sum(p, total)
    return np.asarray(s + (e + f))


def _left(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    return reduce(v.add, (v.multiply(*term) for term in terms))


def _reversed(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    return _left(v, terms[::-1])


def _halves(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    if len(terms) < 3:
        return _left(v, terms)
    half = len(terms) // 2
    return v.add(_halves(v, terms[:half]), _halves(v, terms[half:]))


def _contracted(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    return reduce(_fused, terms[1:], v.multiply(*terms[0]))


def _contracted_first(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    if len(terms) < 2:
        return _left(v, terms)
    return reduce(_fused, terms[2:], _fused(v.multiply(*terms[1]), terms[0]))


def _wide(v: Variation, terms: Sequence[Pair]) -> np.ndarray:
    """Carry the errors of all sums and products to the end: more precision than the type has."""
    total, error = _product(*terms[0])
    for term in terms[1:]:
        p, e = _product(*term)
        total, f = _sum(total, p)
        error = error + (e + f)
    return v.add(total, error)


def _directed(towards: float, exact: Callable[..., Pair], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Round the exact result up, down, or (0) towards zero."""
    value, error = exact(a, b)
    side = -np.sign(value) if towards == 0 else np.full_like(value, towards)
    return np.where(error * side > 0, np.nextafter(value, side * np.inf), value).astype(value.dtype)


def _flushed(operation: Callable[..., np.ndarray], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    value = operation(a, b)
    return np.where(np.abs(value) < np.finfo(value.dtype).tiny, value * 0, value)


def _rounding(towards: float) -> Variation:
    return Variation(partial(_directed, towards, _sum), partial(_directed, towards, _product), _left)


_AS_WRITTEN = Variation(np.add, np.multiply, _left)
VARIATIONS = {
    "contraction": Variation(np.add, np.multiply, _contracted),
    "contraction of the first product": Variation(np.add, np.multiply, _contracted_first),
    "sums from the right": Variation(np.add, np.multiply, _reversed),
    "sums by halves": Variation(np.add, np.multiply, _halves),
    "excess precision": Variation(np.add, np.multiply, _wide),
    "flush to zero": Variation(partial(_flushed, np.add), partial(_flushed, np.multiply), _left),
    "rounding up": _rounding(1.0),
    "rounding down": _rounding(-1.0),
    "rounding towards zero": _rounding(0.0),
}
"""What a compiler's flags or a processor's mode make of the arithmetic, by name."""
