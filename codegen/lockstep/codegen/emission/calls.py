"""Calls of one agent's functions, as arrays: what the C and the reference are both fed."""

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from jaxtyping import Float, UInt


class Operation(IntEnum):
    """What is called.

    STEP_ALIASED passes one buffer as y and as u, and must give the same as STEP; STEP_UNREADY takes a state that is marked as
    never initialised, and initialises it afterwards; APPLIED, of agents whose u is clipped, gives r back as what was applied,
    entry after entry.
    """

    STEP, STEP_RELATIVE, RESET, STEP_ALIASED, STEP_UNREADY, APPLIED = range(6)


@dataclass(frozen=True, eq=False)
class Calls:
    """S calls of one agent: the operation, the mask, own outputs, the neighbours', the relative output."""

    operation: UInt[np.ndarray, " S"]
    received: UInt[np.ndarray, " S"]
    y: Float[np.ndarray, "S q"]
    neighbour_y: Float[np.ndarray, "S nn q"]
    r: Float[np.ndarray, "S q"]

    def __len__(self) -> int:
        return len(self.operation)

    def __add__(self, other: "Calls") -> "Calls":
        parts = [part.name for part in fields(self)]
        return Calls(*(np.concatenate([getattr(self, p), getattr(other, p)]) for p in parts))
