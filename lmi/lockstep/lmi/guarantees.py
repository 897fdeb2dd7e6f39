"""What is proved of given gains besides rho: how fast every disagreement decays, and that controllers are stable alone."""

from dataclasses import dataclass

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.stability import is_stable
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.decay import Decay, fastest_decay, proved_decay
from lockstep.model.network import Network
from lockstep.model.problem import Problem


@dataclass(frozen=True)
class Guarantees:
    """decay: sigma in 1/s, with its certificate, or None;  stable: whether each controller is stable by itself."""

    decay: Decay | None = None
    stable: bool = False


def guarantees(problem: Problem, network: Network, gains: Gains, claim: Claim, *, modal: bool) -> Guarantees:
    """Prove the decay and decide the controllers' stability, both at least as the problem asks.

    Args:
        problem: what is asked.
        network, gains, claim: of the certificate of rho.
        modal: whether that is one of the modes.

    Raises:
        NotCertified: the decay asked for was not proved, or a controller that is to be stable is not.
    """
    table = problem.design
    unstable = [i for i, A_C in enumerate(gains.A, start=1) if not is_stable(A_C)]
    if unstable and table.stable_controllers:
        said = ", ".join(map(str, unstable))
        raise NotCertified(
            f"[design] stable_controllers asks for controllers that are stable by themselves, that of agent {said} is not",
            unstable_controllers=unstable,
        )
    found = fastest_decay(network, gains, claim, modal=modal)
    if table.decay is not None and (found is None or found[0] < table.decay):
        try:
            found = table.decay, proved_decay(network, gains, claim, table.decay, modal=modal)
        except NotCertified:
            reached = 0.0 if found is None else found[0]
            raise NotCertified(
                f"[design] decay asks for {table.decay:g} 1/s, but {reached:g} is proved of these gains",
                decay=reached,
            ) from None
    return Guarantees(found, not unstable)
