"""What one operation needs of its arguments: to have a value, or not to jump.

A condition carries a guard, the `if_else` branches that lead to its operation: where the guard is false the
operation is not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lockstep.check.expression.node import Node
from lockstep.check.expression.switches import TRUE, both


@dataclass(frozen=True)
class Condition:
    """One operation's need: `kind` of the test, its arguments, when it applies, and how to say it."""

    kind: str
    args: tuple[Node, ...]
    name: str
    guard: Node = TRUE

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The guard and the arguments."""
        return (self.guard, *self.args)

    def under(self, guard: Node) -> Condition:
        """Return the condition with one more guard."""
        return Condition(self.kind, self.args, self.name, both(guard, self.guard))

    @property
    def text(self) -> str:
        """Say what the operation needs."""
        return f"{self.name} {_TEXT[self.kind]}"

    @property
    def jumps(self) -> bool:
        """Tell whether it is a discontinuity, not a missing value."""
        return self.kind == "decided"


def changed(
    conditions: Sequence[Condition], change: Callable[[Sequence[Node]], Sequence[Node]]
) -> list[Condition]:
    """Return conditions with their guards and arguments changed, all at once."""
    rest = iter(change([node for c in conditions for node in c.nodes]))
    return [replace(c, guard=next(rest), args=tuple(next(rest) for _ in c.args)) for c in conditions]


HOLDS: Mapping[str, Callable[..., Any]] = {
    "nonzero": lambda x: (x[0] > 0) | (x[1] < 0),
    "positive": lambda x: x[0] > 0,
    "not negative": lambda x: x[0] >= 0,
    "within one": lambda x: (x[0] >= -1) & (x[1] <= 1),
}
"""What an interval, or a number as both of its ends, has where an operation needs it."""

_TEXT = {
    "nonzero": "divides by something that can be 0",
    "positive": "needs a positive argument, which is not proved",
    "not negative": "needs an argument from 0 up, which is not proved",
    "within one": "needs an argument in [-1, 1], which is not proved",
    "no pole": "has a pole",
    "off the cut": "jumps where the second argument is not positive and the first is 0",
    "decided": "jumps where its condition changes and cannot be shown to be continuous there; "
    "write it with min, max or abs",
}
