"""The exact split of an expression into an affine part and a nonlinear rest.

Every scalar SX expression e in the variables z = (x, u) and the time t is brought to the normal form

    e = a z + c + sum_k w_k tau_k(z, t),

with a, c, w_k exact rationals and tau_k *atoms*: products, quotients, powers, elementary functions and
conditions whose own arguments are in normal form again. Constants are distributed over sums, common factors
leave products, and equal atoms are one atom, so 2*(x + sin(x)) - sin(x) is 2 x + 1 sin(x). Products are not
multiplied out: x*(1 - y) is one atom. A coefficient that depends on t makes a term an atom: it belongs to
h(t, x) of (2).

Rationals are rounded once, when an entry of A, B, C, G or a coefficient inside phi is made of them: each is
the double nearest to the exact sum.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca

from lockstep.check.errors import ProblemError
from lockstep.check.wording import as_written
from lockstep.model.coefficients import fraction, is_double, is_exact, scaled, to_double

Row = tuple[tuple[int, Fraction], ...]
"""A linear form in the variables: (index, coefficient) pairs by increasing index, no zeros."""

_ZERO, _ONE = Fraction(0), Fraction(1)
_COMMUTATIVE = frozenset(
    {ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_HYPOT}
)
_OP_NAMES: Mapping[int, str] = {
    getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")
}


@dataclass(frozen=True)
class Affine:
    """A normal form a z + c + sum w_k tau_k: `row` is a, `constant` is c, `terms` are the (k, w_k)."""

    row: Row = ()
    constant: Fraction = _ZERO
    terms: Row = ()

    @property
    def is_constant(self) -> bool:
        """Whether neither variables nor time are in it."""
        return not self.row and not self.terms

    def plus(self, other: "Affine", scale: Fraction = _ONE) -> "Affine":
        """Return self + scale * other."""
        return Affine(
            _add(self.row, other.row, scale),
            self.constant + scale * other.constant,
            _add(self.terms, other.terms, scale),
        )

    def times(self, factor: Fraction) -> "Affine":
        """Return factor * self."""
        return Affine().plus(self, factor)

    def content(self) -> tuple[Fraction, "Affine"]:
        """Return (w, e) with self = w e; w is not 1 only if self is one variable or one atom times w."""
        parts = self.row + self.terms
        if len(parts) != 1 or self.constant:
            return _ONE, self
        return parts[0][1], self.times(1 / parts[0][1])


@dataclass(frozen=True)
class Atom:
    """A nonlinear node: its CasADi operation, its arguments in normal form, and what it depends on."""

    op: int
    arguments: tuple[Affine, ...]
    variables: frozenset[int]
    """Indices of the variables it depends on."""


def _add(a: Row, b: Row, scale: Fraction) -> Row:
    total = dict(a)
    for index, value in b:
        total[index] = total.get(index, _ZERO) + scale * value
    return tuple(sorted((index, value) for index, value in total.items() if value))


class NormalForms:
    """A table of atoms over fixed variables z and time t; expressions split with the same table can be
    compared.

    Args:
        variables: the symbols z, as scalar SX.
        time: the symbol t.
    """

    def __init__(self, variables: Iterable[ca.SX], time: ca.SX) -> None:
        self.variables = list(variables)
        self.time = time
        self.atoms: list[Atom] = []
        self._numbers: dict[tuple[int, tuple[Affine, ...]], int] = {}
        self._index = {symbol.element_hash(): k for k, symbol in enumerate(self.variables)}
        self._arguments: dict[int, frozenset[Row]] = {}

    def split(self, expression: ca.SX) -> Affine:
        """Return the normal form of a scalar expression; the walk uses no recursion, so any depth will do.

        Raises:
            ProblemError: a symbol that is neither a variable nor t, an operation without a normal form, or a
                constant that is not finite.

        >>> x, t = ca.SX.sym("x"), ca.SX.sym("t")
        >>> form = NormalForms([x], t).split((x + ca.sin(x)) / 2 - 3)
        >>> form.row, form.constant, form.terms
        (((0, Fraction(1, 2)),), Fraction(-3, 1), ((0, Fraction(1, 2)),))
        """
        # Hashes are addresses: `alive` keeps every node in memory while they are used as keys.
        done: dict[int, Affine] = {}
        alive: list[ca.SX] = []
        stack = [(ca.SX(expression), False)]
        while stack:
            node, ready = stack.pop()
            key = node.element_hash()
            if key in done:
                continue
            children = [node.dep(k) for k in range(node.n_dep())]
            alive += [node, *children]
            if ready or not children:
                done[key] = self._node(node, [done[child.element_hash()] for child in children])
            else:
                stack += [(node, True), *((child, False) for child in reversed(children))]
        return done[ca.SX(expression).element_hash()]

    def depends_on(self, terms: Row) -> frozenset[int]:
        """Return the indices of the variables that the given atoms depend on."""
        return frozenset().union(*(self.atoms[k].variables for k, _ in terms))

    def arguments(self, form: Affine) -> frozenset[Row]:
        """Return the linear forms `form` depends on the variables through: sin(x - y) only sees x - y."""
        own = frozenset({form.row} if form.row else ())
        return own.union(*(self._atom_arguments(k) for k, _ in form.terms))

    def rebuild(self, form: Affine, substitute: Callable[[Row], ca.SX], time: ca.SX) -> ca.SX:
        """Return `form` as SX, with `substitute` in place of each linear form and `time` in place of t."""
        values: dict[int, ca.SX] = {}
        for k in self._needed(form.terms):
            atom = self.atoms[k]
            deps = [self._value(argument, values, substitute) for argument in atom.arguments]
            values[k] = time if atom.op == ca.OP_PARAMETER else apply(atom.op, deps)
        return self._value(form, values, substitute)

    def rounds(self, form: Affine) -> bool:
        """Whether `rebuild` rounds a coefficient or a constant: 1/3 it does not, a sum of two doubles it may."""
        forms = [form, *(a for k in self._needed(form.terms) for a in self.atoms[k].arguments)]
        exact = all(is_exact(w) for one in forms for _, w in one.terms)
        return not exact or not all(is_double(one.constant) for one in forms)

    def text(self, form: Affine) -> str:
        """Return `form` in the variables' own names, for messages."""

        def original(row: Row) -> ca.SX:
            return total(scaled(self.variables[j], c) for j, c in row)

        return as_written(str(self.rebuild(form, original, self.time)))

    def _node(self, node: ca.SX, children: list[Affine]) -> Affine:
        op = node.op()
        match children:
            case []:
                return self._leaf(node, op)
            case [a]:
                return self._unary(op, a)
            case [a, b]:
                return self._binary(op, a, b)
            case _:
                raise ProblemError(
                    f"the operation `{_OP_NAMES.get(op, op)}` in an expression",
                    expected="arithmetic, elementary functions and conditions",
                    remedy="expand function calls before building the agent",
                )

    def _leaf(self, node: ca.SX, op: int) -> Affine:
        if op == ca.OP_CONST:
            return Affine(constant=fraction(float(node)))
        if node.element_hash() in self._index:
            return Affine(row=((self._index[node.element_hash()], _ONE),))
        if node.element_hash() == self.time.element_hash():
            return self._atom(ca.OP_PARAMETER, ())
        raise ProblemError(
            f"the symbol `{node}` is neither a state, nor an input, nor the time",
            remedy="substitute a number for it, or declare it",
        )

    def _unary(self, op: int, a: Affine) -> Affine:
        if op in (ca.OP_NEG, ca.OP_TWICE):
            return a.times(Fraction(-1 if op == ca.OP_NEG else 2))
        if a.is_constant:
            return self._folded(op, a)
        w, rest = a.content()
        if op == ca.OP_SQ:
            return self._atom(op, (rest,)).times(w * w)
        if op == ca.OP_INV:
            return self._atom(op, (rest,)).times(1 / w)
        return self._atom(op, (a,))

    def _binary(self, op: int, a: Affine, b: Affine) -> Affine:
        if op in (ca.OP_ADD, ca.OP_SUB):
            return a.plus(b, Fraction(1 if op == ca.OP_ADD else -1))
        if a.is_constant and b.is_constant:
            return self._folded(op, a, b)
        if op == ca.OP_MUL:
            return self._product(a, b)
        if op == ca.OP_DIV:
            return self._quotient(a, b)
        if op == ca.OP_IF_ELSE_ZERO and a.is_constant:
            return b if a.constant else Affine()
        return self._atom(op, (a, b))

    def _product(self, a: Affine, b: Affine) -> Affine:
        if a.is_constant or b.is_constant:
            return b.times(a.constant) if a.is_constant else a.times(b.constant)
        (v, a), (w, b) = a.content(), b.content()
        return (
            self._atom(ca.OP_SQ, (a,)).times(v * w) if a == b else self._atom(ca.OP_MUL, (a, b)).times(v * w)
        )

    def _quotient(self, a: Affine, b: Affine) -> Affine:
        if b.is_constant:
            if not b.constant:
                raise ProblemError(f"a division by zero: `{self.text(a)[:60]}` over 0")
            return a.times(1 / b.constant)
        (v, a), (w, b) = a.content(), b.content()
        if a.is_constant:
            return self._atom(ca.OP_INV, (b,)).times(v * a.constant / w)
        return self._atom(ca.OP_DIV, (a, b)).times(v / w)

    def _folded(self, op: int, *arguments: Affine) -> Affine:
        return Affine(constant=fraction(float(apply(op, [ca.SX(to_double(a.constant)) for a in arguments]))))

    def _atom(self, op: int, arguments: tuple[Affine, ...]) -> Affine:
        """Return one times the atom of this operation and arguments, entered in the table if it is new."""
        if op in _COMMUTATIVE:
            arguments = tuple(sorted(arguments, key=lambda a: (a.row, a.terms, a.constant)))
        number = self._numbers.setdefault((op, arguments), len(self.atoms))
        if number == len(self.atoms):
            own = frozenset(j for a in arguments for j, _ in a.row)
            self.atoms.append(Atom(op, arguments, own.union(*(self.depends_on(a.terms) for a in arguments))))
        return Affine(terms=((number, _ONE),))

    def _needed(self, terms: Row) -> list[int]:
        """Return the atoms the given ones are made of, parts first: an atom's number exceeds its parts'."""
        needed: set[int] = set()
        stack = [k for k, _ in terms]
        while stack:
            k = stack.pop()
            if k not in needed:
                needed.add(k)
                stack += [j for a in self.atoms[k].arguments for j, _ in a.terms]
        return sorted(needed)

    def _atom_arguments(self, number: int) -> frozenset[Row]:
        for k in self._needed(((number, _ONE),)):
            if k not in self._arguments:
                rows = {a.row for a in self.atoms[k].arguments if a.row}
                parts = [self._arguments[j] for a in self.atoms[k].arguments for j, _ in a.terms]
                self._arguments[k] = frozenset(rows).union(*parts)
        return self._arguments[number]

    def _value(self, form: Affine, values: Mapping[int, ca.SX], substitute: Callable[[Row], ca.SX]) -> ca.SX:
        parts = [substitute(form.row)] if form.row else []
        parts += [scaled(values[k], w) for k, w in form.terms]
        if form.constant:
            parts.append(ca.SX(to_double(form.constant)))
        return total(parts)


def apply(op: int, arguments: list[ca.SX]) -> ca.SX:
    """Apply a CasADi operation to one or two scalar expressions."""
    return ca.SX.unary(op, *arguments) if len(arguments) == 1 else ca.SX.binary(op, *arguments)


def total(parts: Iterable[ca.SX]) -> ca.SX:
    """Add up expressions; none at all give 0."""
    value = ca.SX(0)
    for part in parts:
        value = value + part
    return value
