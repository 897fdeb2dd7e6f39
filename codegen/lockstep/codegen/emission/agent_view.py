"""What the templates of the C need to know of one agent, its comments aside."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import Optimize
from lockstep.codegen.cost.bounds import bounds
from lockstep.codegen.cost.budget import Extent
from lockstep.codegen.emission.kernel import Kernel
from lockstep.codegen.spec import Controller


@dataclass(frozen=True, eq=False)
class Sampled:
    """One controller ready for printing: its table [A B; C D], weights, limits (m x 2, or none), offsets, in its type."""

    controller: Controller
    table: np.ndarray
    weights: np.ndarray
    kernel: Kernel
    limits: np.ndarray
    offsets: np.ndarray | None

    def bounds(self, real: RealType, optimize: Optimize) -> dict[str, dict[str, int]]:
        """What the header bounds, per core."""
        return bounds(Extent(self.shape, bool(len(self.limits)), self.offsets is not None), real, optimize)

    @property
    def shape(self) -> Shape:
        """nc, q, m, nn."""
        inputs, outputs = self.controller.D.shape
        return Shape(self.controller.order, outputs, inputs, len(self.controller.neighbours))


def agent_view(agent: Sampled, real: RealType) -> dict[str, Any]:
    """Return the view: numbers as C literals of the target type."""

    def literals(rows: Float[np.ndarray, "rows cols"]) -> list[list[str]]:
        return [[real.literal(v) for v in row] for row in rows]

    name, M, shape = agent.controller.name, agent.table, agent.shape
    n, m, nn = shape.order, shape.inputs, shape.neighbours
    mask_bits = 32 if nn <= 32 else 64
    parts = {"x": M[:, :n], "r": M[:, n:]}
    offsets = [] if agent.offsets is None else literals(agent.offsets)
    return {
        "name": name,
        "NAME": name.upper(),
        "order": n,
        "q": shape.outputs,
        "m": m,
        "nn": nn,
        "rows": n + m,
        "columns": n + shape.outputs,
        "mask_bits": mask_bits,
        "all_received": f"0x{2**nn - 1:x}u" + ("ll" if mask_bits == 64 else ""),
        "weights": [real.literal(w) for w in agent.weights],
        "unit_weights": bool((agent.weights == 1).all()),
        "table": literals(M),
        "limits": bool(len(agent.limits)),
        "lower": [low for low, _ in literals(agent.limits)],
        "upper": [high for _, high in literals(agent.limits)],
        "offsets": [c for row in offsets for c in row] if nn else [],
        "offset_rows": [[c.rstrip("f") for c in row] for row in offsets],
        "statements": agent.kernel.statements,
        "unread": [letter for letter, part in parts.items() if part.shape[1] and not part.any()],
        "checked": _checked(M, n),
    }


def _checked(M: Float[np.ndarray, "rows cols"], order: int) -> list[str]:
    """What must be finite for a step to count: (x+, u), and each r_k that no row of the kernel reads.

    A read r_k that is NaN or infinite makes its row NaN or infinite, so it needs no check of its own.
    """
    idle = [k for k in range(M.shape[1] - order) if not M[:, order + k].any()]
    next_ = [f"x_next[{k}]" for k in range(order)] + [f"u_next[{k}]" for k in range(M.shape[0] - order)]
    return [*next_, *(f"r[{k}]" for k in idle)]
