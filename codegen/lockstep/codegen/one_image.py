"""One image for all nodes: what it is made for."""

from dataclasses import dataclass
from typing import Literal, get_args

from lockstep.check.c_source.reader import MAX_NEIGHBOURS
from lockstep.check.errors import ProblemError, demand

ONE_IMAGE_FROM = 17
"""Agents from which `generate` writes one image unasked, where all gains are the same: fewer have files of their own."""

Table = Literal["none", "csv", "c"]
TABLES = get_args(Table)


@dataclass(frozen=True)
class OneImage:
    """What one image is made for.

    name: prefix of the nodes' functions;  agents: N of the design, 1 for any number;  degree: the most neighbours of any of
    them;  most: of a list, at compile time;  table: of whom each node hears, as C for an image that holds all lists, or as
    CSV for what installs them;  lists: (source from 0, weight) of every node, for the table.
    """

    name: str
    agents: int
    degree: int
    most: int
    table: Table = "none"
    lists: tuple[tuple[tuple[int, float], ...], ...] = ()

    def __post_init__(self) -> None:
        if self.table not in TABLES:
            raise ProblemError(f"`{self.table}`", where="--table", expected=" or ".join(TABLES))
        expected = f"1 to {MAX_NEIGHBOURS}: one mask bit each"
        demand(1 <= self.most <= MAX_NEIGHBOURS, f"{self.most} neighbours at most", "one image", expected)
        if self.degree > self.most:
            raise ProblemError(
                f"an agent hears {self.degree} others, and a list holds {self.most}",
                where="one image",
                expected=f"--max-neighbours {self.degree} or more",
            )

    @property
    def mask_bits(self) -> int:
        """Width of the mask of what arrived."""
        return 32 if self.most <= 32 else 64
