"""Which names an agent and its states, inputs, outputs and parameters may have, and what must be there for each."""

import keyword
import re
from collections.abc import Callable, Mapping, Sequence
from sys import float_info

from lockstep.check.errors import ProblemError, demand
from lockstep.check.expression.text import CONSTANTS, FUNCTIONS, RESERVED
from lockstep.check.wording import nearest, shorten
from lockstep.model.formulas.confusables import advice_to_retype

LONGEST_AGENT_NAME = 20
"""C99 tells external names apart by 31 characters (5.2.4.1), and the agent's number and `_step` follow."""

LONGEST_NAME = 60

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
C_WORDS = frozenset(
    """auto bool break case char const constexpr continue default do double else enum extern false float for goto if
    inline int long main nullptr register restrict return short signed sizeof static struct switch true typedef
    typeof union unsigned void volatile while alignas alignof asm complex imaginary noreturn catch class delete explicit
    export friend mutable namespace new operator private protected public template this throw try using
    virtual""".split()  # noqa: SIM905
)
"""The keywords of C, and those of C++, whose programs may include the header."""


def check_agent_name(name: str) -> None:
    """Refuse a name that cannot prefix C identifiers.

    >>> check_agent_name("float")
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: [agent] name: `float` is a word of C; expected a name of your own,
    such as `arm`
    """
    where = "[agent] name"
    why = "C compilers may tell names apart by their first 31 characters only"
    _check_identifier(name, where, "a C identifier", LONGEST_AGENT_NAME, why)
    found = f"`{name}` is a word of C"
    demand(name not in C_WORDS, found, where, "a name of your own, such as `arm`")


def check_names(
    *, states: Sequence[str], inputs: Sequence[str], outputs: Sequence[str], parameters: Sequence[str] = ()
) -> None:
    """Refuse names that no expression could mention, or that mean two things.

    Outputs may have the name of the state they show, but not of one another.
    """
    kinds = {"states": states, "inputs": inputs, "parameters": parameters}
    for kind, names in [*kinds.items(), ("outputs", outputs)]:
        if not names and kind != "parameters":
            raise ProblemError(f"there are no {kind}", where=f"[agent] {kind}", expected="at least one")
        for name in names:
            _check_name(name, f"[agent] {kind}")
    _check_unique([(name, kind) for kind, names in kinds.items() for name in names])
    _check_unique([(name, "outputs") for name in outputs])


def _check_identifier(name: str, where: str, kind: str, longest: int, why: str = "") -> None:
    if not isinstance(name, str) or not _IDENTIFIER.fullmatch(name):
        expected = "an ASCII letter, then letters, digits and _"
        found, remedy = f"`{shorten(str(name))}` is not {kind}", advice_to_retype(str(name))
        raise ProblemError(found, where=where, expected=expected, remedy=remedy)
    if len(name) > longest:
        found = f"`{shorten(name)}` has {len(name)} characters"
        raise ProblemError(found, where=where, expected=f"at most {longest}", remedy=why)


def _check_name(name: str, where: str) -> None:
    _check_identifier(name, where, "a name", LONGEST_NAME)
    if name in RESERVED:
        meaning = "a function" if name in FUNCTIONS else "a constant" if name in CONSTANTS else "the time"
        found = f"`{name}` is already {meaning} in expressions"
        raise ProblemError(found, where=where, expected="another name")
    found = f"`{name}` is a word of Python and cannot be a name in expressions"
    demand(not keyword.iskeyword(name), found, where, "another name", f"for instance `{name}_`")


def _check_unique(names: Sequence[tuple[str, str]]) -> None:
    seen: dict[str, str] = {}
    for name, kind in names:
        if name in seen:
            other = "twice" if seen[name] == kind else f"in {seen[name]} too"
            raise ProblemError(f"`{name}` is {other}", where=f"[agent] {kind}", expected="names that differ")
        seen[name] = kind


def check_known(
    where: str, given: Mapping[str, object], known: Sequence[str], remedy: Callable[[str], str] = lambda _: ""
) -> None:
    """Refuse a name that is none of the known ones; remedy: what to do where it is near to none of them."""
    for name in given:
        if name not in known:
            found, expected = f"`{shorten(name)}` is unknown", shorten(", ".join(known), 120)
            close = nearest(name, known) or remedy(name)
            raise ProblemError(found, where=where, expected=expected, remedy=close)


def check_formulas(states: Sequence[str], dynamics: Mapping[str, str]) -> None:
    """One equation per state, and none without a state."""
    where, unknown = "[agent.dynamics]", [name for name in dynamics if name not in states]
    for state in states:
        if state not in dynamics:
            found, expected = f"no equation for the state `{state}`", f'{state} = "its time derivative"'
            raise ProblemError(found, where=where, expected=expected, remedy=nearest(state, unknown))
    if unknown:
        close, one = nearest(unknown[0], states), shorten(unknown[0])
        remedy = f'{close}{" " if close else ""}if it is a state, add "{one}" to `states`'
        expected = shorten(", ".join(states), 120)
        raise ProblemError(f"`{one}` is unknown", where=where, expected=expected, remedy=remedy)


def check_parameters(parameters: Mapping[str, float]) -> None:
    """Refuse a parameter that is no finite number."""
    for key, value in parameters.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= float_info.max:
            said = f"`{key}` is {shorten(repr(value))}"
            raise ProblemError(said, where="[agent.parameters]", expected="a finite number")
