"""The witness of a floor as it stands in a design file, piece by piece.

Of the symmetric Z and Z_dual the lower triangle is written, row by row; the last piece ends at infinity, written as null.
"""

import math
from typing import Annotated, Any

import numpy as np

from lockstep.check.design_file.json_text import number, only
from lockstep.check.errors import ProblemError
from lockstep.check.floor.witness import FloorWitness, Piece


def pieces_document(witness: FloorWitness) -> list[dict[str, Any]]:
    """Return the pieces of a witness as plain JSON types."""
    return [
        {
            "upper": piece.upper if math.isfinite(piece.upper) else None,
            "Z": _triangle(piece.Z),
            "Z_dual": _triangle(piece.Z_dual),
            "k": piece.k.tolist(),
        }
        for piece in witness.pieces
    ]


def witness_of(rho: float, pieces: Any, where: str) -> FloorWitness:
    """Read the witness of a floor rho.

    Raises:
        ProblemError: it is not one by its form.
    """
    if not isinstance(pieces, list):
        raise ProblemError("it is missing or no list", where=where, expected="a list of pieces")
    return FloorWitness(
        rho, tuple(_piece(piece, f"{where}, piece {i}") for i, piece in enumerate(pieces, start=1))
    )


def _triangle(M: Annotated[np.ndarray, "a a"]) -> list[list[float]]:
    return [M[i, : i + 1].tolist() for i in range(len(M))]


def _piece(piece: Any, where: str) -> Piece:
    if not isinstance(piece, dict):
        raise ProblemError(f"a {type(piece).__name__}", where=where, expected="an object")
    only(piece, ("upper", "Z", "Z_dual", "k"), where)
    upper = piece.get("upper")
    return Piece(
        math.inf if upper is None else number(upper, f"{where}, `upper`"),
        _symmetric(piece.get("Z"), f"{where}, `Z`"),
        _symmetric(piece.get("Z_dual"), f"{where}, `Z_dual`"),
        _rectangular(piece.get("k"), f"{where}, `k`"),
    )


def _symmetric(rows: Any, where: str) -> Annotated[np.ndarray, "a a"]:
    lengths = list(range(1, len(rows) + 1)) if isinstance(rows, list) else []
    found = _rows(rows, lengths, where)
    M = np.zeros((len(found), len(found)))
    for i, row in enumerate(found):
        M[i, : i + 1] = M[: i + 1, i] = row
    return M


def _rectangular(rows: Any, where: str) -> Annotated[np.ndarray, "a b"]:
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
