"""Poles and singular values of the loop's linear part, by python-control.

In disagreement coordinates and with phi = 0 the loop (15) is linear; the certificate covers phi as well, so its
rho is above the largest singular value from the disturbances w that it counts to what it weighs,

    sup_w sigma_max(C_z (jw I - A_cl)^-1 E + D_z) <= rho,      w = (xi_d, nu_d) in the scales of the claim,

z the weighted disagreement, controller states and inputs: the channel `continuous.inequality.disturbance` of the proof.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Complex, Float

from lockstep.check.continuous.inequality import Claim, disturbance
from lockstep.check.system.loop import Gains, Loop
from lockstep.lmi.analysis.decimals import above
from lockstep.model.network import Network
from lockstep.report.canvas import legend, logarithmic, panels, rows_of
from lockstep.report.style import LIGHT, MARKERS, colour, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_STATES = 120
"""Of a loop whose singular values are drawn: beyond, they would take longer than the rest of the page."""

MOST_CONTROLLERS = 8
"""Controllers whose poles have a mark of their own; more of them share one."""

MOST_POLES = 600
"""States of a loop whose poles are computed: beyond, that takes longer than the rest of the page too."""

POINTS = 240
"""Frequencies over which singular values are drawn."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """What is known of the linear loop.

    loop: poles of the disagreement with the controllers, in 1/s, none for a loop that is too large;  controllers: poles
    of each controller alone;  omega: frequencies in rad/s;  sigma: singular values from w to z at each, largest
    first, or None for a loop too large for them.
    """

    loop: Complex[np.ndarray, " poles"]
    controllers: tuple[Complex[np.ndarray, " n_C"], ...]
    omega: Float[np.ndarray, " K"]
    sigma: Float[np.ndarray, "K values"] | None

    @property
    def abscissa(self) -> float | None:
        """The largest real part of the loop's poles, in 1/s."""
        return float(self.loop.real.max()) if len(self.loop) else None

    @property
    def peak(self) -> tuple[float, float] | None:
        """The largest singular value drawn, and its frequency in rad/s."""
        if self.sigma is None:
            return None
        at = int(self.sigma[:, 0].argmax())
        return float(self.sigma[at, 0]), float(self.omega[at])


def spectrum_of(network: Network, gains: Gains, claim: Claim) -> Spectrum:
    """Return poles and singular values of a network under continuous gains.

    Args:
        network: the agents on their graph.
        gains: the controllers (9).
        claim: what rho is a gain from and to.
    """
    controllers = tuple(np.atleast_1d(one.poles()) for one in network.controllers_to_control(gains))
    states = (network.N - 1) * network.agent.n + gains.N * gains.order
    if states > MOST_POLES:
        return Spectrum(np.zeros(0, complex), controllers, np.zeros(0), None)
    poles = np.asarray(network.to_control(gains, linear=True).poles())
    omega, loop = _frequencies(poles), network.loop(gains.order)
    sigma = _singular_values(loop, gains, claim, omega) if states <= MOST_STATES else None
    return Spectrum(poles, controllers, omega, sigma)


def _frequencies(poles: Complex[np.ndarray, " poles"]) -> Float[np.ndarray, " K"]:
    """A decade to either side of the moduli of the poles, and the moduli themselves: resonances are near them."""
    moduli = np.abs(poles[np.abs(poles) > 0])
    if not len(moduli):
        moduli = np.ones(1)
    grid = np.geomspace(moduli.min() / 10, moduli.max() * 10, POINTS)
    return np.unique(np.concatenate([grid, moduli, np.abs(poles.imag[poles.imag > grid[0]])]))


def _singular_values(
    loop: Loop, gains: Gains, claim: Claim, omega: Float[np.ndarray, " K"]
) -> Float[np.ndarray, "K values"]:
    import control

    w, K = disturbance(loop, replace(claim, delta=np.zeros_like(claim.delta))), gains.blocks
    unit = np.linalg.inv(np.linalg.cholesky(w.cone[0].Pi_w)).T
    answers, enters = K @ np.array(loop.Y), K @ np.array(w.Y or np.zeros((len(K), K.shape[2], w.E.shape[1])))
    B, C, D = w.E + (np.array(loop.U) @ enters).sum(axis=0), [], []
    for term in w.fixed:
        root = _root(term.Pi_z)
        taken = np.array(term.D_z or np.zeros((len(K), len(root), K.shape[1])))
        C.append(root @ (term.C_z + (taken @ answers).sum(axis=0)))
        D.append(root @ (taken @ enters).sum(axis=0) @ unit)
    system = control.ss(loop.A_cl(K), B @ unit, np.vstack(C), np.vstack(D))
    response = control.singular_values_response(system, omega)
    return np.asarray(response.magnitude).reshape(-1, len(omega)).T


def _root(M: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """The symmetric square root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(M)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


@styled
def poles_figure(spectrum: Spectrum, agent: str) -> "Figure":
    """Draw the poles of the loop and of each controller in the complex plane; the shaded half is unstable."""
    together = len(spectrum.controllers) > MOST_CONTROLLERS
    entries = 1 + (1 if together else len(spectrum.controllers))
    figure, (axes,) = panels(1, 2.1, rows=rows_of(entries, 2))
    for k, poles in enumerate(spectrum.controllers):
        label = f"{agent}{k + 1}'s controller" if not together else "controllers" if k == 0 else ""
        axes.plot(
            poles.real,
            poles.imag,
            linestyle="none",
            marker=MARKERS[0 if together else k % len(MARKERS)],
            markerfacecolor="none",
            markersize=6.5,
            color=colour(1 if together else k),
            label=label if len(poles) else "",
        )
    axes.plot(
        spectrum.loop.real,
        spectrum.loop.imag,
        linestyle="none",
        marker="x",
        markeredgewidth=1.6,
        color=LIGHT["ink"],
        label="the loop" if len(spectrum.loop) else "",
    )
    axes.axvline(0.0, color=LIGHT["soft"], linewidth=1.0)
    axes.margins(0.08)
    low, high = axes.get_xlim()
    high = max(high, 0.08 * (high - low))
    axes.axvspan(0.0, high, color=LIGHT["soft"], alpha=0.13, linewidth=0)
    axes.set_xlim(low, high)
    axes.set_xlabel("real part in 1/s")
    axes.set_title("imaginary part in rad/s")
    legend(figure, axes, 2)
    return figure


@styled
def singular_values_figure(spectrum: Spectrum, rho: float | None) -> "Figure":
    """Draw the singular values from disturbances to weighted disagreement over frequency, with the certified rho above them.

    Raises:
        ValueError: the loop was too large for singular values.
    """
    if spectrum.sigma is None:
        raise ValueError("there are no singular values to draw")
    figure, (axes,) = panels(1, 1.8, rows=1)
    for k, values in enumerate(spectrum.sigma.T):
        look = {"linewidth": 1.6} if k == 0 else {"linewidth": 0.7, "alpha": 0.75}
        label = {0: "largest", 1: "the others"}.get(k, "")
        axes.loglog(spectrum.omega, values, color=colour(0), label=label, **look)
    if rho is not None:
        axes.axhline(rho, color=colour(1), linestyle=(0, (5, 1.6)), label=f"certified rho = {above(rho, 4)}")
    top = max(spectrum.sigma[:, 0].max(), rho or 0.0)
    axes.set_ylim(top * 1e-4, top * 2)
    axes.margins(x=0)
    axes.set_xlabel("frequency in rad/s")
    axes.set_title("singular values, disturbances to disagreement")
    logarithmic(axes.xaxis, axes.yaxis)
    legend(figure, axes, 3)
    return figure
