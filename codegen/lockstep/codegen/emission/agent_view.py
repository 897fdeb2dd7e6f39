"""What the templates of the C need to know of one agent, its comments aside."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.c_source.kernel import Shape


def agent_view(
    name: str,
    shape: Shape,
    M: Float[np.ndarray, "rows cols"],
    weights: Float[np.ndarray, " nn"],
    *,
    statements: Sequence[str],
    table: Sequence[Sequence[str]],
    weight_literals: Sequence[str],
    limit_literals: Sequence[Sequence[str]] = (),
    offset_literals: Sequence[Sequence[str]] = (),
) -> dict[str, Any]:
    """Return the view.

    Args:
        name: prefix of the C.
        shape: nc, q, m, nn.
        M: [A B; C D] in the target type;  weights: a_j.
        statements: of the unrolled kernel;  table, weight_literals, limit_literals: M, a_j and, where u is clipped, its
            lowest and highest values as C literals.
        offset_literals: of a formation: c of this agent's outputs, then of each neighbour's.
    """
    n, m, nn = shape.order, shape.inputs, shape.neighbours
    mask_bits = 32 if nn <= 32 else 64
    parts = {"x": M[:, :n], "r": M[:, n:]}
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
        "weights": weight_literals,
        "unit_weights": bool((weights == 1).all()),
        "table": table,
        "limits": bool(limit_literals),
        "lower": [low for low, _ in limit_literals],
        "upper": [high for _, high in limit_literals],
        "offsets": [c for row in offset_literals for c in row] if nn else [],
        "offset_rows": [[c.rstrip("f") for c in row] for row in offset_literals],
        "statements": statements,
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
