"""Formulas of a problem file as MathML, which browsers typeset without a script.

The text has been through the model's own parser (`lockstep.model.formulas.expression`), so its grammar is Python's with
nothing but numbers, names, operators and calls. A sum becomes one `<math>` element per term: a narrow page breaks the line
between them.
"""

import ast
import unicodedata
from collections.abc import Iterator

from markupsafe import Markup, escape

FINAL_SIGMA = 0x3C2
GREEK = {
    unicodedata.name(chr(code)).split()[-1].lower(): chr(code)
    for code in range(0x3B1, 0x3CA)
    if code != FINAL_SIGMA
} | {"lambda": "λ"}
"""Letter by name; Unicode writes "lamda"."""

_PLAIN = Markup("{}")
_RELATIONS = {ast.Lt: "<", ast.LtE: "≤", ast.Gt: ">", ast.GtE: "≥"}
_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(1, 6)
_APART = Markup('<mo>\u2062</mo><mspace width="0.16em"></mspace>')
"""Times: not seen but heard, with a little room."""
_MINUS = Markup('<mo form="infix">−</mo>')
"""Between two terms; at the start of a formula it is a sign and needs less room."""


def equation(left: Markup, text: str) -> Markup:
    """Return `left = text`, breakable before each term of the sum.

    >>> equation(derivative("v"), "-2*v + u").count("<math>")
    3
    """
    terms = list(_terms(ast.parse(text.strip(), mode="eval").body))
    parts = [_math(left + _op("="))]
    for k, (minus, term) in enumerate(terms):
        parts.append(_math(_sign(minus, k) + _node(term, _PRODUCT)))
    return Markup(" ").join(parts)


def derivative(name: str) -> Markup:
    """Return the symbol of a name with a dot over its letter."""
    return symbol(name, Markup('<mover accent="true">{}<mo>˙</mo></mover>'))


def symbol(name: str, around: Markup = _PLAIN) -> Markup:
    """Return a name as a symbol: Greek where it spells a Greek letter, what follows `_` or a letter as its index.

    >>> str(symbol("theta_m"))
    '<msub><mi>θ</mi><mi>m</mi></msub>'
    >>> str(symbol("y1")), str(symbol("gravity"))
    ('<msub><mi>y</mi><mn>1</mn></msub>', '<mi>gravity</mi>')
    """
    base, _, index = name.partition("_")
    if not index and base[:-1] in {*GREEK, base[:1]} and base[-1:].isdigit():
        base, index = base[:-1], base[-1]
    if not base:
        return around.format(_tag("mi", name))
    head = around.format(_tag("mi", GREEK.get(base, base)))
    if not index:
        return head
    said = " ".join(GREEK.get(part, part) for part in index.split("_") if part)
    return Markup("<msub>{}{}</msub>").format(head, _tag("mn" if said.isdigit() else "mi", said))


def inline(name: str) -> Markup:
    """Return a name as a formula of its own."""
    return _math(symbol(name))


def _terms(node: ast.expr, minus: bool = False) -> Iterator[tuple[bool, ast.expr]]:
    """Take a sum apart: (whether it is subtracted, term)."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as operator, right):
            yield from _terms(left, minus)
            yield from _terms(right, minus is not isinstance(operator, ast.Sub))
        case ast.UnaryOp(ast.USub(), inner):
            yield from _terms(inner, not minus)
        case ast.UnaryOp(ast.UAdd(), inner):
            yield from _terms(inner, minus)
        case _:
            bare = _without_minus(node)
            yield minus != (bare is not None), node if bare is None else bare


def _without_minus(node: ast.expr) -> ast.expr | None:
    """Return a product without the minus before its first factor, or None if there is none: `-2*x` is `-(2*x)`."""
    match node:
        case ast.UnaryOp(ast.USub(), inner):
            return inner
        case ast.BinOp(left, ast.Mult() | ast.Div() as operator, right):
            bare = _without_minus(left)
            return None if bare is None else ast.BinOp(bare, operator, right)
    return None


def _node(node: ast.expr, around: int) -> Markup:
    """Return a node, in parentheses if it binds less than what is around it."""
    written, binds = _written(node)
    return _op("(") + written + _op(")") if binds < around else written


def _written(node: ast.expr) -> tuple[Markup, int]:
    match node:
        case ast.Constant(value):
            return _number(value), _ATOM
        case ast.Name(name):
            return (_tag("mi", "π") if name == "pi" else symbol(name)), _ATOM
        case ast.BinOp(base, ast.Pow(), exponent):
            raised = Markup("<msup><mrow>{}</mrow><mrow>{}</mrow></msup>")
            return raised.format(_node(base, _ATOM), _node(exponent, 0)), _POWER
        case ast.BinOp(above, ast.Div(), below):
            fraction = Markup("<mfrac><mrow>{}</mrow><mrow>{}</mrow></mfrac>")
            return fraction.format(_node(above, 0), _node(below, 0)), _ATOM
        case ast.BinOp(left, ast.Mult(), right):
            times = _op("·") if isinstance(right, ast.Constant) else _APART
            return _node(left, _PRODUCT) + times + _node(right, _SIGN), _PRODUCT
        case ast.BinOp(_, ast.Add() | ast.Sub(), _) | ast.UnaryOp(ast.USub() | ast.UAdd(), _):
            return _sum(node), _SUM
        case ast.Compare(left, [relation], [right]):
            return _node(left, _SUM) + _op(_RELATIONS[type(relation)]) + _node(right, _SUM), 0
        case ast.Call(ast.Name(function), arguments):
            return _call(function, arguments), _ATOM
    raise ValueError(f"not a formula of a problem file: {ast.unparse(node)}")


def _sum(node: ast.expr) -> Markup:
    parts = []
    for k, (minus, term) in enumerate(_terms(node)):
        parts += [_sign(minus, k), _node(term, _PRODUCT)]
    return Markup("").join(parts)


def _sign(minus: bool, k: int) -> Markup:
    """The sign of term k of a sum, counted from 0."""
    if not k:
        return _op("−") if minus else Markup("")
    return _MINUS if minus else _op("+")


def _call(function: str, arguments: list[ast.expr]) -> Markup:
    inside = _op(",").join(_node(argument, 0) for argument in arguments)
    match function:
        case "sqrt":
            return Markup("<msqrt>{}</msqrt>").format(inside)
        case "abs" | "fabs":
            return _op("|") + inside + _op("|")
    return _tag("mi", function) + _op("\u2061") + _op("(") + inside + _op(")")


def _number(value: object) -> Markup:
    """Return a number as it reads: 1e-3 as a power of ten."""
    mantissa, _, exponent = repr(value).partition("e")
    if not exponent:
        return _tag("mn", mantissa.removesuffix(".0"))
    power = Markup("<msup><mn>10</mn><mn>{}</mn></msup>").format(str(int(exponent)).replace("-", "−"))
    return power if mantissa == "1" else _tag("mn", mantissa) + _op("·") + power


def _math(content: Markup) -> Markup:
    return Markup("<math>{}</math>").format(content)


def _op(sign: str) -> Markup:
    """An operator: fences as tall as a letter, and room before a sign that begins a term."""
    form = dict.fromkeys("()|", ' stretchy="false"') | {"+": ' form="infix"'}
    return Markup("<mo{}>{}</mo>").format(Markup(form.get(sign, "")), sign)


def _tag(tag: str, text: str) -> Markup:
    return Markup(f"<{tag}>{escape(text)}</{tag}>")
