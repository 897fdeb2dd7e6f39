"""A proved floor as it stands in design.json: `floor`, `floor_proof`, and `floor_witness`, piece by piece.

Of the symmetric Z and Z_dual the lower triangle is written, row by row; the last piece ends at infinity, written as null.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.floor.witness import FloorWitness, Piece
from lockstep.lmi.json_parts import number

EXACT, NONE = "exact", "none"


def floor_keys(witness: FloorWitness | None) -> dict[str, Any]:
    """Return the keys of a design file, whether a floor is proved or not."""
    if witness is None:
        return {"floor": None, "floor_proof": NONE}
    pieces = [
        {
            "upper": piece.upper if math.isfinite(piece.upper) else None,
            "Z": _triangle(piece.Z),
            "Z_dual": _triangle(piece.Z_dual),
            "k": piece.k.tolist(),
        }
        for piece in witness.pieces
    ]
    return {"floor": witness.rho, "floor_proof": EXACT, "floor_witness": pieces}


def floor_of(content: Mapping[str, Any]) -> FloorWitness | None:
    """Return the floor that a file says is proved, with its witness; None where it gives none.

    Raises:
        ProblemError: a floor without a proof, or a witness that is not one by its form.
    """
    if content.get("floor") is None:
        return None
    rho, proof, pieces = (content.get(key) for key in ("floor", "floor_proof", "floor_witness"))
    if proof != EXACT:
        raise ProblemError(f"`floor_proof` is {proof!r}", expected='"exact", or no `floor`')
    if not isinstance(pieces, list):
        raise ProblemError("`floor_witness` is missing or no list", expected="a list of pieces")
    found = tuple(_piece(piece, f"floor_witness, piece {i}") for i, piece in enumerate(pieces, start=1))
    return FloorWitness(number(rho, "floor"), found)


def _triangle(M: Float[np.ndarray, "a a"]) -> list[list[float]]:
    return [M[i, : i + 1].tolist() for i in range(len(M))]


def _piece(piece: Any, where: str) -> Piece:
    if not isinstance(piece, dict):
        raise ProblemError(f"a {type(piece).__name__}", where=where, expected="an object")
    upper = piece.get("upper")
    return Piece(
        math.inf if upper is None else number(upper, f"{where}, `upper`"),
        _symmetric(piece.get("Z"), f"{where}, `Z`"),
        _symmetric(piece.get("Z_dual"), f"{where}, `Z_dual`"),
        _rectangular(piece.get("k"), f"{where}, `k`"),
    )


def _symmetric(rows: Any, where: str) -> Float[np.ndarray, "a a"]:
    lengths = list(range(1, len(rows) + 1)) if isinstance(rows, list) else []
    found = _rows(rows, lengths, where)
    M = np.zeros((len(found), len(found)))
    for i, row in enumerate(found):
        M[i, : i + 1] = M[: i + 1, i] = row
    return M


def _rectangular(rows: Any, where: str) -> Float[np.ndarray, "a b"]:
    width = len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else 0
    found = _rows(rows, [width] * len(rows) if isinstance(rows, list) else [], where)
    return np.array(found, dtype=float).reshape(len(found), width)


def _rows(rows: Any, lengths: list[int], where: str) -> list[list[float]]:
    if not isinstance(rows, list) or any(
        not isinstance(row, list) or len(row) != length for row, length in zip(rows, lengths, strict=True)
    ):
        raise ProblemError(
            "it is missing or has another shape", where=where, expected="rows of numbers, of a triangle for Z"
        )
    return [[number(value, where) for value in row] for row in rows]
