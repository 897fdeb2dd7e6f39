"""One lifted period with its slopes in E E' and F'F: in doubles, for the search.

What `lifting` computes from Gamma = exp(T [-A', -F'F; E E', A]) = [Gamma_11, Gamma_12; Gamma_21, Gamma_22] is
differentiated backwards. A function with the slopes a, s, q in A_d, S and Q has, with X = Gamma_11^-1, the slopes

    g_X = a' + Gamma_21' s - q Gamma_12',   g_11 = -X' g_X X',   g_12 = -X' q,   g_21 = s X'

in the blocks of Gamma (a and s filled up with zeros), and in the exponent those of the derivative of the exponential at
the transpose: <g, D exp(H)[dH]> = <D exp(H')[g], dH>.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.lifting import Lifted
from lockstep.lmi.sampled.l2_gain import is_lifted


@dataclass(frozen=True, eq=False)
class LiftedPeriod:
    """A lifted period, and the exponential it was computed from.

    exponent: T [-A', -F'F; E E', A], inputs included;  Gamma: its exponential;  X: Gamma_11^-1.
    """

    lifted: Lifted
    exponent: Float[np.ndarray, "g g"]
    Gamma: Float[np.ndarray, "g g"]
    X: Float[np.ndarray, "a a"]
    period: float

    def pulled_back(
        self, a: Float[np.ndarray, "n a"], s: Float[np.ndarray, "n n"], q: Float[np.ndarray, "a a"]
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]]:
        """Return the slopes in E E' and F'F, symmetric, of a function with the slopes a, s, q in A_d, S and Q."""
        from scipy.linalg import expm_frechet

        n, size = self.lifted.n, len(self.X)
        g_A, g_S = np.zeros((size, size)), np.zeros((size, size))
        g_A[:n], g_S[:n, :n] = a, (s + s.T) / 2
        q = (q + q.T) / 2
        g_X = g_A.T + self.Gamma[size:, :size].T @ g_S - q @ self.Gamma[:size, size:].T
        slope = np.zeros_like(self.Gamma)
        slope[:size, :size] = -self.X.T @ g_X @ self.X.T
        slope[:size, size:], slope[size:, :size] = -self.X.T @ q, g_S @ self.X.T
        back = self.period * expm_frechet(self.exponent.T, slope, compute_expm=False)
        EE, FF = back[size : size + n, :n], -back[:n, size : size + n]
        return (EE + EE.T) / 2, (FF + FF.T) / 2


def lifted_period(
    A: Float[np.ndarray, "n n"],
    B: Float[np.ndarray, "n k"],
    EE: Float[np.ndarray, "n n"],
    FF: Float[np.ndarray, "n n"],
    period: float,
) -> LiftedPeriod | None:
    """Return one period of x' = A x + B v + E w, z = F x, as `lifting.lift` does; None past a conjugate point."""
    from scipy.linalg import expm

    n, k = B.shape
    size = n + k
    H = np.zeros((2 * size, 2 * size))
    H[size : size + n, size : size + n], H[size : size + n, size + n :] = A, B
    H[:n, :n], H[n:size, :n] = -A.T, -B.T
    H[:n, size : size + n], H[size : size + n, :n] = -FF, EE
    try:
        Gamma = expm(period * H)
        X = np.linalg.inv(Gamma[:size, :size])
    except (np.linalg.LinAlgError, ValueError, OverflowError):
        return None
    S, Q = (Gamma[size:, :size] @ X)[:n, :n], -X @ Gamma[:size, size:]
    lifted = Lifted(X.T[:n], (S + S.T) / 2, (Q + Q.T) / 2)
    return LiftedPeriod(lifted, period * H, Gamma, X, period) if is_lifted(lifted) else None
