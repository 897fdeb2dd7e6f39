"""What a design file needs of the problem it holds, whoever builds it from the file's tables."""

from typing import NamedTuple, Protocol


class Sizes(NamedTuple):
    """N agents of n states, m inputs and q outputs, each with a controller of n_C states."""

    N: int
    n: int
    m: int
    q: int
    n_C: int


class ProblemPart(Protocol):
    """A problem that was read from the tables of a design file."""

    @property
    def sizes(self) -> Sizes:
        """The sizes that the gains and the witnesses of the file must fit."""
