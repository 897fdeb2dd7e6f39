"""How a long computation says where it stands."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the part of it that is done, from 0 to 1."""


def silent(_what: str, _part: float = 0.0) -> None:
    """Say nothing."""
