"""phi(v, t) as exact expressions, with what must hold for them to have a value."""

from dataclasses import dataclass

from lockstep.check.expression.condition import Condition
from lockstep.check.expression.node import Node


@dataclass(frozen=True)
class ExactPhi:
    """phi(v, t): `outputs` over the variables 0..inputs-1 (v) and `inputs` (t), and what it needs."""

    outputs: tuple[Node, ...]
    conditions: tuple[Condition, ...]
    inputs: int
