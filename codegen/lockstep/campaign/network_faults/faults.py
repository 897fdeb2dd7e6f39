"""What a network may do to messages in a campaign, as text and as numbers."""

import math
from dataclasses import dataclass, fields

from lockstep.check.errors import ProblemError

MOST_LATE = 60
"""Periods: as many messages of a link are under way at the most, less some room for those that come twice."""


@dataclass(frozen=True)
class NetworkFaults:
    """What happens to messages and nodes; the defaults are a network without faults.

    loss: probability of each message, independent;  to_bad, to_good: of Gilbert's and Elliott's chain per period, every
    message being lost in the bad state;  burst: at most so many lost in a row, whatever the rest says (None: any number);
    delay: least and most periods, drawn for each message, so that they overtake each other;  jitter: part of the period
    within which an agent's sampling instant is drawn;  twice: probability that a message comes twice;  corrupt: that a
    bit of it is flipped;  restarts: probability per period that a node stops;  silence: periods until it starts anew.
    """

    loss: float = 0.0
    to_bad: float = 0.0
    to_good: float = 1.0
    burst: int | None = None
    delay: tuple[int, int] = (0, 0)
    jitter: float = 0.0
    twice: float = 0.0
    corrupt: float = 0.0
    restarts: float = 0.0
    silence: int = 0

    def __post_init__(self) -> None:
        for name in ("loss", "to_bad", "to_good", "jitter", "twice", "corrupt", "restarts"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0 <= value <= 1):
                raise ProblemError(f"{name} is {value}", where="faults", expected="a number from 0 to 1")
        least, most = self.delay
        if not 0 <= least <= most <= MOST_LATE // 2:
            found = f"a delay of {least} to {most} periods"
            raise ProblemError(
                found, where="faults", expected=f"whole numbers, least first, up to {MOST_LATE // 2}"
            )
        if (self.burst is not None and self.burst < 0) or self.silence < 0:
            raise ProblemError("a negative number of periods", where="faults", expected="0 or more")

    @classmethod
    def parse(cls, text: str) -> "NetworkFaults":
        """Read `name=value` pairs.

        >>> NetworkFaults.parse("loss=0.5, delay=0:5, burst=5").delay
        (0, 5)
        >>> NetworkFaults.parse("lost=0.5")
        Traceback (most recent call last):
        lockstep.check.errors.ProblemError: faults: `lost`; expected loss, to_bad, ...
        """
        known = {one.name for one in fields(cls)}
        given: dict[str, float | int | tuple[int, int]] = {}
        for pair in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (part.strip() for part in pair.partition("="))
            if name not in known or name in given:
                raise ProblemError(
                    f"`{name}`", where="faults", expected=", ".join(one.name for one in fields(cls))
                )
            try:
                if name == "delay":
                    least, _, most = value.partition(":")
                    given[name] = (int(least), int(most or least))
                else:
                    given[name] = int(value) if name in ("burst", "silence") else float(value)
            except ValueError:
                raise ProblemError(
                    f"`{pair}`", where="faults", expected="a number; of delay, least:most"
                ) from None
        return cls(**given)  # type: ignore[arg-type]

    @property
    def oldest(self) -> int | None:
        """Periods that what is held is old at the most, D of the certificate; None if there is no such number."""
        unbounded = self.burst is None and (self.loss or self.to_bad or self.corrupt)
        return None if unbounded or self.restarts else self.delay[1] + (self.burst or 0)

    def row(self, noise: float = 0.0) -> list[float]:
        """Return the numbers in the order of the C, with the standard deviation of noise on each state."""
        burst = -1.0 if self.burst is None else float(self.burst)
        network = [self.loss, self.to_bad, self.to_good, burst, *map(float, self.delay), self.jitter]
        return [*network, self.twice, self.corrupt, self.restarts, float(self.silence), noise]
