"""Exact expressions: a hash-consed graph with rational constants and two normal forms.

A node is a constant, a variable, a linear combination `c0 + sum c_i x_i`, a monomial `prod x_i^p_i` with
whole powers, or a named function of nodes. Constants are rational, so that every IEEE double is taken
exactly and nothing is rounded before the interval evaluation. Equal expressions are the same object, so
`is` compares them and terms cancel: `sin(x)*cos(x) - cos(x)*sin(x)` is the constant 0.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import weakref
from collections.abc import Hashable, Iterable, Mapping
from fractions import Fraction
from typing import Any


class Undefined(ArithmeticError):
    """An exact operation has no value, such as the reciprocal of the constant 0."""


class Node:
    """One operation of an expression graph; made by the functions of this module and the operators, numbers on the left."""

    __slots__ = ("__weakref__", "args", "data", "op", "place", "serial", "variables")

    op: str
    args: tuple[Node, ...]
    data: Any
    serial: int
    place: tuple[int, bytes]
    """Where it stands among the terms of a sum or product: variables by number, then the rest by what they say, so that
    nothing depends on what was built before."""
    variables: frozenset[int]

    def __neg__(self) -> Node:
        return scale(-1, self)

    def __add__(self, other: Node) -> Node:
        return add(self, other)

    def __radd__(self, offset: Fraction | int) -> Node:
        return linear(offset, [(1, self)])

    def __sub__(self, other: Node) -> Node:
        return linear(0, [(1, self), (-1, other)])

    def __rsub__(self, offset: Fraction | int) -> Node:
        return linear(offset, [(-1, self)])

    def __mul__(self, other: Node) -> Node:
        return multiply(self, other)

    def __rmul__(self, factor: Fraction | int) -> Node:
        return scale(factor, self)

    def __truediv__(self, other: Node) -> Node:
        return multiply(self, power(other, -1))

    def __rtruediv__(self, factor: Fraction | int) -> Node:
        return scale(factor, power(self, -1))

    def __pow__(self, exponent: int) -> Node:
        return power(self, exponent)


_INTERNED: weakref.WeakValueDictionary[Hashable, Node] = weakref.WeakValueDictionary()


_SERIAL = itertools.count()
_AFTER_VARIABLES = 1 << 62


def intern(op: str, args: tuple[Node, ...] = (), data: Hashable = None) -> Node:
    """Return the one node of this operation, arguments and data; nothing is simplified."""
    key = (op, tuple(a.serial for a in args), data)
    node = _INTERNED.get(key)
    if node is None:
        node = Node()
        node.op, node.args, node.data, node.serial = op, args, data, next(_SERIAL)
        node.place = _place(op, args, data)
        own = frozenset([data]) if op in ("variable", "inner_end") and isinstance(data, int) else frozenset()
        node.variables = own.union(*(a.variables for a in args))
        _INTERNED[key] = node
    return node


def _place(op: str, args: tuple[Node, ...], data: Hashable) -> tuple[int, bytes]:
    if op == "variable" and isinstance(data, int):
        return data, b""
    said = hashlib.blake2b(f"{op} {_said(data)}".encode(), digest_size=16)
    for a in args:
        said.update(b"%d " % a.place[0] + a.place[1])
    return _AFTER_VARIABLES, said.digest()


def _said(data: Any) -> str:
    """Return the data of a node as text; whole numbers in base 16, which takes no time however long they are."""
    if isinstance(data, tuple):
        return f"({','.join(map(_said, data))})"
    return f"{data.numerator:x}/{data.denominator:x}" if isinstance(data, Fraction) else repr(data)


def constant(value: Fraction | int) -> Node:
    """Return the node of an exact rational number."""
    return intern("constant", (), Fraction(value))


def variable(index: int) -> Node:
    """Return the node of variable number `index`."""
    return intern("variable", (), index)


ZERO, ONE, MINUS_ONE = constant(0), constant(1), constant(-1)


def number(node: Node) -> Fraction | None:
    """Return the value of a constant node, None for any other."""
    return node.data if isinstance(node.data, Fraction) and node.op == "constant" else None


def linear_terms(node: Node) -> tuple[Fraction, tuple[tuple[Fraction, Node], ...]]:
    """Return (c0, ((c_i, x_i), ...)) of any node seen as a linear combination."""
    if node.op == "linear":
        offset, coefficients = node.data
        return offset, tuple(zip(coefficients, node.args, strict=True))
    value = number(node)
    return (Fraction(0), ((Fraction(1), node),)) if value is None else (value, ())


def linear(offset: Fraction | int, terms: Iterable[tuple[Fraction | int, Node]]) -> Node:
    """Return `offset + sum c_i x_i` in normal form: flat, like terms collected."""
    total, collected = Fraction(offset), dict[Node, Fraction]()
    for factor, node in terms:
        inner_offset, inner = linear_terms(node)
        total += factor * inner_offset
        for c, x in inner:
            collected[x] = collected.get(x, Fraction(0)) + factor * c
    kept = sorted(((x, c) for x, c in collected.items() if c), key=lambda item: item[0].place)
    if not kept:
        return constant(total)
    if len(kept) == 1 and kept[0][1] == 1 and not total:
        return kept[0][0]
    return intern("linear", tuple(x for x, _ in kept), (total, tuple(c for _, c in kept)))


def add(*nodes: Node) -> Node:
    """Return the sum of the nodes."""
    return linear(0, [(1, n) for n in nodes])


def scale(factor: Fraction | int, node: Node) -> Node:
    """Return factor * node."""
    return linear(0, [(factor, node)])


def factors(node: Node) -> tuple[Fraction, dict[Node, int]]:
    """Return (c, {x_i: p_i}) with node = c * prod x_i^p_i."""
    if node.op == "monomial":
        return Fraction(1), dict(zip(node.args, node.data, strict=True))
    value = number(node)
    if value is not None:
        return value, {}
    if node.op == "linear":
        offset, terms = linear_terms(node)
        if not offset and len(terms) == 1:
            _, powers = factors(terms[0][1])
            return terms[0][0], powers
    return Fraction(1), {node: 1}


def product(coefficient: Fraction | int, powers: Mapping[Node, int]) -> Node:
    """Return coefficient * prod x_i^p_i in normal form; powers of `exp` are merged into one."""
    kept = {x: p for x, p in powers.items() if p}
    exponents = [(p, x.args[0]) for x, p in kept.items() if x.op == "exp"]
    if len(exponents) > 1 or any(p != 1 for p, _ in exponents):
        kept = {x: p for x, p in kept.items() if x.op != "exp"}
        merged = function("exp", linear(0, exponents))
        if merged is not ONE:
            kept[merged] = kept.get(merged, 0) + 1
    if not coefficient or not kept:
        return constant(coefficient)
    for x in [x for x, p in kept.items() if x.op == "sinh" and p > 0]:
        cosh = intern("cosh", x.args)
        if kept.get(cosh, 0) < 0:  # sinh/cosh = tanh stays bounded where sinh and cosh do not
            p = kept.pop(x)
            tanh = function("tanh", *x.args)
            return product(coefficient, {**kept, cosh: kept[cosh] + p, tanh: kept.get(tanh, 0) + p})
    pairs = sorted(kept.items(), key=lambda item: item[0].place)
    plain = len(pairs) == 1 and pairs[0][1] == 1
    core = (
        pairs[0][0] if plain else intern("monomial", tuple(x for x, _ in pairs), tuple(p for _, p in pairs))
    )
    return scale(coefficient, core)


def multiply(*nodes: Node) -> Node:
    """Return the product of the nodes."""
    coefficient, powers = Fraction(1), dict[Node, int]()
    for node in nodes:
        c, own = factors(node)
        coefficient *= c
        for x, p in own.items():
            powers[x] = powers.get(x, 0) + p
    return product(coefficient, powers)


def power(node: Node, exponent: int) -> Node:
    """Return node^exponent for a whole exponent; raises `Undefined` for 0 to a negative one."""
    coefficient, powers = factors(node)
    if not coefficient and exponent < 0:
        raise Undefined("the reciprocal of 0")
    return product(coefficient**exponent, {x: p * exponent for x, p in powers.items()})


# Values at 0 that are exact, and what a function makes of a negated argument.
_AT_ZERO = {
    **dict.fromkeys(("exp", "cos", "cosh", "sech2"), ONE),
    **dict.fromkeys(("sin", "tan", "asin", "atan", "sinh", "tanh", "sqrt", "fabs"), ZERO),
}


_ODD = frozenset({"sin", "tan", "asin", "atan", "sinh", "tanh"})


_EVEN = frozenset({"cos", "cosh", "sech2", "fabs"})


def function(op: str, *args: Node, data: Hashable = None) -> Node:
    """Return the named function of the arguments, simplified where that is exact."""
    first, value = args[0], number(args[0])
    if len(args) == 1 and value is not None:
        if value == 0 and op in _AT_ZERO:
            return _AT_ZERO[op]
        folded = _fold(op, value)
        if folded is not None:
            return folded
    if op in _ODD | _EVEN and _leading_sign(first) < 0:
        mirrored = function(op, scale(-1, first))
        return mirrored if op in _EVEN else scale(-1, mirrored)
    if op in ("fmin", "fmax"):
        other = number(args[1])
        if first is args[1]:
            return first
        if value is not None and other is not None:
            return constant(min(value, other) if op == "fmin" else max(value, other))
    return intern(op, args, data)


def _leading_sign(node: Node) -> int:
    offset, terms = linear_terms(node)
    leading = terms[0][0] if terms else offset
    return -1 if leading < 0 else 1


def _fold(op: str, value: Fraction) -> Node | None:
    if op == "fabs":
        return constant(abs(value))
    if op == "log" and value == 1:
        return ZERO
    if op == "sqrt" and value > 0 and value.denominator < 1 << 200:
        root = Fraction(math.isqrt(value.numerator), math.isqrt(value.denominator))
        return constant(root) if root * root == value else None
    return None
