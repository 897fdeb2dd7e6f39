"""The structure of a perturbation: w_i = Delta_i z_i, block by block, complex, for z = M w."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lockstep.check.errors import ProblemError


@dataclass(frozen=True)
class Block:
    """One block of Delta: (rows, columns) = (length of w_i, of z_i); repeated: delta I instead of a full matrix."""

    rows: int
    columns: int
    repeated: bool = False


@dataclass(frozen=True)
class Structure:
    """All blocks, in order."""

    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, given: Sequence[int | tuple[int, int]] | None, shape: tuple[int, ...]) -> "Structure":
        """Read a structure: (r, c) is a full block, k is delta I_k; None: 1, 1, 1, ... of a square M.

        Raises:
            ProblemError: blocks that do not fit z = M w.

        >>> Structure.of([(2, 1), 2], (3, 4)).blocks
        (Block(rows=2, columns=1, repeated=False), Block(rows=2, columns=2, repeated=True))
        """
        read = [Block(b, b, b > 1) if isinstance(b, int) else Block(*b) for b in given or [1] * shape[0]]
        found = cls(tuple(read))
        sizes = sum(b.columns for b in found.blocks), sum(b.rows for b in found.blocks)
        if sizes != tuple(shape) or any(min(b.rows, b.columns) < 1 for b in found.blocks):
            raise ProblemError(
                f"blocks {list(given or [])} for a matrix of {' x '.join(map(str, shape))}",
                where="structured singular value",
                expected="blocks whose columns add up to its rows and whose rows add up to its columns",
            )
        return found

    @property
    def of_z(self) -> list[slice]:
        """The places of the z_i."""
        return _places([b.columns for b in self.blocks])

    @property
    def of_w(self) -> list[slice]:
        """The places of the w_i."""
        return _places([b.rows for b in self.blocks])


def _places(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum(sizes)
    return [slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]
