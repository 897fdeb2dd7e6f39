"""The target's real type: rounding to it, its C spelling, and literals that read back to the same bits."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.discretise import Real, rounded_to


@dataclass(frozen=True)
class RealType:
    """`float32` is C's `float` with the suffix f, `float64` is `double` without one."""

    name: Real

    @property
    def dtype(self) -> np.dtype[Any]:
        """The NumPy type."""
        return np.dtype(self.name)

    @property
    def c_name(self) -> str:
        """`float` or `double`."""
        return "float" if self.name == "float32" else "double"

    @property
    def bytes(self) -> int:
        """Size in memory."""
        return self.dtype.itemsize

    def round(self, M: Float[np.ndarray, "..."], where: str) -> Float[np.ndarray, "..."]:
        """Round float64 values to the nearest target value, ties to even; raises if one becomes infinite."""
        return rounded_to(self.name, M, where)

    def decimal(self, value: float) -> str:
        """Shortest decimal that reads back to the same bits, as a C literal without suffix, whatever NumPy's own form of it.

        >>> RealType("float32").decimal(np.float32(0.1)), RealType("float64").decimal(1e22)
        ('0.1', '1e+22')
        >>> [RealType("float32").decimal(x) for x in (1e6, 999999.0, -2.5e-5, 0.0)]
        ['1e+06', '999999.0', '-2.5e-05', '0.0']
        """
        if self.name == "float64":
            return repr(float(value))
        x = np.float32(value)
        if x == 0 or 1e-4 <= abs(float(x)) < 1e6:
            return np.format_float_positional(x, trim="0")
        return np.format_float_scientific(x, trim="-", exp_digits=2)

    def literal(self, value: float) -> str:
        """A literal of the target type: no arithmetic with it is ever done in double by accident.

        >>> RealType("float32").literal(-0.25), RealType("float64").literal(-0.25)
        ('-0.25f', '-0.25')
        """
        return self.decimal(value) + ("f" if self.name == "float32" else "")
