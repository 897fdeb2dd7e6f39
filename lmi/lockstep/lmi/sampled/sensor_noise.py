"""What noise of the sensors does to the inputs of the sampled loop: computed of its linear part, not proved."""

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import step_matrix
from lockstep.check.sampled.lifting import copies
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles


def noise_to_inputs(
    network: SampledNetwork, controllers: tuple[HeldController, ...]
) -> Float[np.ndarray, "m q"] | None:
    """Return the root mean square of each input per standard deviation of the noise of each output, of the worst agent.

    Noise is white, at each reading, independent from agent to agent. With x_cl+ = A x_cl + E nu_d and u = C x_cl + F nu_d,

        X = A X A' + E W E',   rms(u_l)^2 = (C X C' + F W F')_ll,   W = T T' (x) I,

    phi being left out (`lockstep.check.sampled.loop`). None where the linear loop is not stable.
    """
    from scipy.linalg import solve_discrete_lyapunov

    _, m, q, _, _ = network.plant.sizes
    found = []
    for k in range(q):
        loop = in_doubles(network, controllers, np.eye(q)[k])
        one, T = period_in_doubles(loop), np.asarray(loop.network.d.T, dtype=float)
        if one is None:
            return None
        step, n = step_matrix(loop, copies(one, np.eye(len(T)))), loop.n_x
        A, E, C, F = (rows[:, part] for rows in (step, loop.computed) for part in (slice(0, n), loop.outputs))
        if np.abs(np.linalg.eigvals(A)).max(initial=0.0) >= 1:
            return None
        W = T @ T.T
        X = solve_discrete_lyapunov(A, E @ W @ E.T)
        found.append(np.sqrt(np.diag(C @ X @ C.T + F @ W @ F.T)).reshape(-1, m).max(axis=0))
    return np.array(found).T
