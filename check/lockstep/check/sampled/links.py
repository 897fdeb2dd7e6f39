"""What a network does to the messages on its links, and the witness of what is proved of it: `messages` says of what."""

import itertools
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lockstep.check.numbers import Matrix
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.loop import SampledLoop

MOST_LINKS = 8
"""Up to so many links lose messages each with a probability of its own, which takes 2^links matrices; more lose alike."""


@dataclass(frozen=True)
class Messages:
    """What a network does to messages.

    loss: p0;  burst: b;  delay: the least and the most periods;  jitter: part of a period.
    """

    loss: float = 0.0
    burst: int = 0
    delay: tuple[int, int] = (0, 0)
    jitter: float = 0.0

    @property
    def age(self) -> int:
        """D, in periods."""
        return self.burst + self.delay[1]

    @property
    def text(self) -> str:
        """What happens, for people."""
        said = (
            (self.loss, f"a chance of loss of at most {self.loss:g}"),
            (self.burst, f"{'besides ' * bool(self.loss)}up to {self.burst} lost in a row"),
            (self.delay[1], f"up to {self.delay[1]} period{'s' * (self.delay[1] > 1)} late"),
            (self.jitter, f"a jitter of {self.jitter:g}"),
        )
        return ", ".join(text for happens, text in said if happens) or "every message in time"

    def within(self, proved: "Messages") -> bool:
        """Tell whether no more happens than was proved for, and no message is earlier."""
        mine, theirs = (
            (one.loss, one.burst, -one.delay[0], one.delay[1], one.jitter) for one in (self, proved)
        )
        return all(a <= b for a, b in zip(mine, theirs, strict=True))

    def alike(self, links: int) -> bool:
        """Tell whether so many links are taken to lose alike."""
        return self.loss > 0 and links > MOST_LINKS

    def losses(self, links: int) -> np.ndarray:
        """Return p of so many links as parts of p0, row by row: the corners, or 0, 1/2 and 1 where they lose alike."""
        if not self.loss:
            return np.zeros((1, links))
        if self.alike(links):
            return np.outer([0.0, 0.5, 1.0], np.ones(links))
        return np.array(list(itertools.product((0.0, 1.0), repeat=links)))


@dataclass(frozen=True, eq=False)
class MessageWitness:
    """P, Gamma (n_x + links, n_x + links), X, Xj (links, q) block below block, m, t and numbers as of `inequality`.

    X_chance, X_change, X_sum: Xa, Xb and Xs like X, or all None.
    """

    P: Annotated[np.ndarray, "n n"]
    Gamma: Annotated[np.ndarray, "n n"]
    X: Annotated[np.ndarray, "links q"]
    X_jitter: Annotated[np.ndarray, "links q"]
    m: Annotated[np.ndarray, " pairs"]
    t: Annotated[np.ndarray, " ways"]
    decay: float
    kappa: float
    kappa_mu: float
    X_chance: Annotated[np.ndarray, "links q"] | None = None
    X_change: Annotated[np.ndarray, "links q"] | None = None
    X_sum: Annotated[np.ndarray, "links q"] | None = None

    @property
    def seconds(self) -> tuple[Matrix, ...]:
        """Xa, Xb and Xs, those that there are."""
        return tuple(one for one in (self.X_chance, self.X_change, self.X_sum) if one is not None)

    def fits(self, loop: SampledLoop) -> bool:
        """Tell whether the sizes are those of a loop, forms symmetric, prices and numbers in their ranges."""
        n, links, q = loop.n_x + len(loop.differences), len(loop.differences), len(loop.network.plant.C)
        shapes = (
            *(one.shape for one in (self.P, self.Gamma, self.X, self.X_jitter, *self.seconds)),
            self.m.shape,
            self.t.shape,
        )
        if shapes != (
            (n, n),
            (n, n),
            *[(links, q)] * (2 + len(self.seconds)),
            (len(loop.network.d.pairs()),),
            (len(loop.ways),),
        ):
            return False
        forms = (
            self.P,
            self.Gamma,
            *(one for X in (self.X, self.X_jitter, *self.seconds) for one in np.split(X, links // q)),
        )
        return (
            len(self.seconds) in (0, 3)
            and all(np.array_equal(one, one.T) for one in forms)
            and bool(np.all(self.m >= 0) and np.all(self.t >= 0))
            and 0 < self.decay <= 1
            and self.kappa > 0
            and self.kappa_mu > 0
        )

    def prices(self, loop: SampledLoop) -> Witness:
        """Return what `stored_matrix` needs of it: no storage, and nothing for the messages' errors."""
        none = np.zeros((loop.n_x, loop.n_x))
        return Witness(none, self.m, self.t, 0.0, 0.0, kappa_mu=self.kappa_mu)
