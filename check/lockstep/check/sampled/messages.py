"""Messages that are lost by chance, lost in bursts, late, or of jittered instants: the sampled loop with what listeners hold.

Listener i holds of source j the difference of stamped outputs, d_e = a_ij (y_i - y_j) of one instant for each link e. What
is assumed of each link, `loss` p0, `burst` b, `delay` up to l periods, `jitter`:

    h_e(k) = d_e(k) + eta_e(k)  with probability 1 - p_e(k), else h_e(k - 1): chance loses a message, or the newest comes;
             0 <= p_e(k) <= p0 depends on what happened before in any way, and given that the links are independent;
    held   = h_e(k - theta_e(k)),  0 <= theta_e(k) <= D = b + l in any pattern: b lost in a row, then up to l periods late;
    eta_e  = the change of d_e over at most the last jitter T_s before the instant at which it was to be read.

So without `loss` the ages are at most D; with it, what chance spares, or something newer, is known D periods later. At
the start h(-1) is any vector that was held for ever: V counts it, and 0 stands for "nothing arrived yet".

With eps(k) = h(k - 1) - d(k) beside x_cl, zeta1(k) = h(k) - d(k) and zeta(k) = held - d(k), which is in the place of the
messages' errors of `loop`,

    eps+ = zeta1 - Y (x_cl+ - x_cl),       zeta1_e = delta_e eps_e + (1 - delta_e) eta_e,   delta_e = 1 with probability p_e,
    zeta = zeta1 + w,   w(k) = h(k - theta) - h(k) = -sum_{s < theta} g(k - s),
    g_e  = h_e(k) - h_e(k - 1) = (1 - delta_e) (eta_e - eps_e).

Age: by Cauchy and Schwarz w'X w <= D sum_{s < D} g(k - s)'X g(k - s), for every X >= 0 of the size of an output, one for
each link (Kao and Rantzer 2007: a gain of D). With V_w(k) = c sum_{s=1}^{D-1} (D - s) decay^s g(k - s)'X g(k - s) and
c = D decay^-D,

    V_w(k + 1) - decay V_w(k) = c decay (D g(k)'X g(k) - sum_{s<D} decay^s g(k - s)'X g(k - s))
                             <= D^2 decay^(1 - D) g(k)'X g(k) - w(k)'X w(k).

What chance held back is a jump when it is let go, which D g counts too often. So a second bound may stand beside the first:
zeta = w_a + w_b, w_a(k) = zeta1(k - theta) and w_b(k) = d(k - theta) - d(k) = -sum_{s < theta} v(k - s), v(k) = d(k) - d(k
- 1). Then w_a'Xa w_a <= sum_{s <= D} zeta1(k - s)'Xa zeta1(k - s), and w_b'Xb w_b <= D sum_{s < D} v(k - s)'Xb v(k - s) as
above. The same sums as V_w, over D + 1 periods and up to v(k), turn these into

    (D + 1) decay^(-D) zeta1'Xa zeta1 - w_a'Xa w_a,     D^2 decay^(-D) v+'Xb v+ - w_b'Xb w_b,     v+ = Y (x_cl+ - x_cl),

and w_a'Xa w_a + w_b'Xb w_b >= zeta'Xs zeta wherever [Xa - Xs, -Xs; -Xs, Xb - Xs] >= 0. At the start d was d(0) for ever,
zeta1 was eps(0), and the sum of it counts.

Jitter: |eta_e(k + 1)|^2 in the form Xj <= jitter T_s int (Y x_d')'Xj (Y x_d') dt over the period before (Cauchy and
Schwarz), a way out of the period that is lifted; what decays is V + eta'Xj eta + V_w. Readings of two agents for one
instant that are s seconds apart differ from this by at most s |y'|: an error of the message, as any other, that kappa
counts.

The proof has two halves, with a form Gamma on (x_cl, zeta1) between them. First, for every rounding, underflow and
nonlinearity, with z^ = (z, zeta1) and the step (x_cl+, eps+) = A_z^ z^ + E^ w_d,

    V(x_cl+, eps+) + jitter T_s int |Y x_d'|_Xj^2 + D^2 decay^(-D) v+'Xb v+
        < (x_cl, zeta1)'Gamma (x_cl, zeta1) + w'X w + zeta'Xs zeta + kappa |error|^2 + kappa_mu |mu|^2,

by Omega_1 > 0, a Schur complement as in `inequality`; with (zeta - zeta1, zeta) = (w, w_a + w_b) + [I; I] error, the form
X^ - X^ [I; I] [I; I]'X^ / kappa of it, X^ = diag(X, Xs), is below the least of the right side. It holds for each outcome of
delta, before it is averaged. Second, the mean over delta,

    E ((x_cl, zeta1)'Gamma (x_cl, zeta1) + (D + 1) decay^(-D) zeta1'Xa zeta1 + D^2 decay^(1 - D) g'X g)
        < decay (V(x_cl, eps) + eta'Xj eta):                                                     Omega_2 > 0,

given what happened before, E of a square being that of the mean and p_e (1 - p_e) (eps_e - eta_e)'Gamma_ee (eps_e - eta_e)
for each link. As delta_e^2 = delta_e, what is averaged is affine in each delta_e, so that Omega_2 is affine in each p_e:
between its values at p_e = 0 and p_e = p0, the other probabilities being what they are. Nothing else depends on p, not V,
not V_w, so

    Omega_2 > 0 at the 2^links corners p_e in {0, p0}

proves it at every instant, whatever the p_e(k) up to p0 are. With more than `MOST_LINKS` links it is proved of links that
lose alike, p_e(k) = p(k): Omega_2 is of degree 2 in p then, and positive on [0, p0] where its coefficients of Bernstein are,

    Omega_2(0),   2 Omega_2(p0 / 2) - (Omega_2(0) + Omega_2(p0)) / 2,   Omega_2(p0).

With p0 = 0 nothing is random, and the decay is that of each run; with p0 > 0 it is that of the mean square, and with
probability 1 there is agreement as well. With rho, both halves hold with decay 1 and the cost of `l2_gain`. The outputs'
own noise nu is then in what is read, eta_e + Y_nu nu in the place of eta_e with Y_nu its columns of `differences`, and
nowhere else: Omega_1 has no column of it (zeta holds what was read), and rho^2 T_s nu'(S (x) I) nu stands on the right of
the second half.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import Matrix, block_diagonal, converter, exactly, eye, is_exact, zeros
from lockstep.check.sampled import balls
from lockstep.check.sampled.conjugate_points import lifted_if_regular
from lockstep.check.sampled.controller import SampledNetwork
from lockstep.check.sampled.inequality import multiplier, step_matrix, stored_matrix
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import SampledLoop


def proves_messages(
    exact_loop: SampledLoop,
    messages: Messages,
    witness: MessageWitness,
    weights: Performance | None = None,
    rho: float | None = None,
) -> bool:
    """Decide in balls whether a witness proves agreement under what happens to the messages, or rho with weights.

    Without rho the decay has to be below 1; with it the decay is 1, and rho is the gain that `l2_gain` states, from the
    disturbances and the outputs' noise, in the mean square where messages are lost by chance.

    Args:
        exact_loop: assembled from the controllers, with the outputs' own noise where rho is a gain from it.
        messages: what happens to them.
        witness: from wherever.
        weights, rho: of the gain, where one is claimed.
    """
    plain = rho is None or weights is None
    if not (witness.fits(exact_loop) and 0 <= messages.loss < 1 and 0 <= messages.jitter < 1):
        return False
    if plain != (witness.decay < 1) or messages.age < 0 or not (rho is None or rho > 0):
        return False
    with balls.working_precision():
        M = multiplier(exact_loop.network.d, exactly(witness.m))
        forms = [exactly(witness.P), M, *(links_apart(exactly(X)) for X in (witness.X, witness.X_jitter))]
        if witness.seconds:
            Xa, Xb, Xs = (links_apart(exactly(X)) for X in witness.seconds)
            forms += [Xs, np.block([[Xa - Xs, -Xs], [-Xs, Xb - Xs]])]
        if not all(balls.is_positive_definite(one) for one in forms):
            return False
        parts = period_parts(exact_loop, messages, witness, M, weights, rho)
        running = None if weights is None or rho is None else running_cost(exact_loop, weights, rho)
        if parts is None or not all(
            balls.is_positive_definite(one) for one in Omegas_2(exact_loop, messages, witness, running)
        ):
            return False
        one = lifted_if_regular(*parts, exact_loop.network.period)
        return one is not None and balls.is_positive_definite(
            Omega_1(exact_loop, one, messages, witness, running)
        )


def period_parts(
    loop: SampledLoop,
    messages: Messages,
    witness: MessageWitness,
    M: Matrix,
    weights: Performance | None = None,
    rho: float | None = None,
) -> tuple[Matrix, Matrix, Matrix, Matrix] | None:
    """Return A, B, E E' and C_z'C_z, this on (x_d, u_d), of one period, for `lift`; None where jitter has too much weight.

    With prices Pi_w of w = (phi, xi) and Xi = jitter T_s Xj on Y x_d' = Y (A x_d + B u_d + E w), completing the square gives

        Pi = Pi_w - (Y E)'Xi Y E > 0,   w = w^ + Pi^-1 (Y E)'Xi Y [A B] a,
        [A B] + E Pi^-1 (Y E)'Xi Y [A B],   E Pi^-1 E',   C_z'C_z + [A B]'Y'(Xi + Xi Y E Pi^-1 (Y E)'Xi) Y [A B].
    """
    network, number = loop.network, converter(is_exact(loop.held))
    unit, plant = eye(network.d.N - 1, M), network.plant
    flow = np.hstack([np.kron(unit, plant.A), np.kron(unit, loop.into)])
    GG, HH = network.squares
    E, price = np.kron(unit, plant.G), np.kron(M, _component_prices(network))
    if not GG.any():
        E, price = E[:, :0], price[:0, :0]
    CC = np.kron(M, HH)
    if weights is not None and rho is not None:
        scales = weights.states if len(weights.states) else np.ones(len(GG))
        E = np.hstack([E, np.kron(unit, number(np.diag(scales)))])
        square = number(np.array([rho]))[0] ** 2 * np.kron(network.d.S, eye(len(GG), M))
        price = block_diagonal(price, square)
        CC = CC + np.kron(network.d.S, number(weights.R))
    held = flow.shape[1] - len(CC)
    CC = block_diagonal(CC, zeros(held, held, CC))
    if messages.jitter:
        part, T_s = number(np.array([messages.jitter, network.period]))
        Xi, Y = part * T_s * links_apart(number(witness.X_jitter)), loop.differences[:, : loop.n_d]
        YE, rates = balls.product(Y, E), balls.product(Y, flow)
        price = price - balls.product(YE.T, Xi, YE)
        if is_exact(price) and not balls.is_positive_definite(price):
            return None
        back = balls.product(balls.inverse(price), YE.T, Xi, rates)
        CC = CC + balls.product(rates.T, Xi, rates + balls.product(YE, back))
        flow = flow + balls.product(E, back)
    n = loop.n_d
    return flow[:, :n], flow[:, n:], balls.product(E, balls.inverse(price), E.T), (CC + CC.T) / 2


def _component_prices(network: SampledNetwork) -> Matrix:
    """Return the price of phi of one agent: Pi_w of a sector, else I."""
    number = converter(is_exact(network.plant.A))
    Pi_w = np.ones(network.plant.G.shape[1]) if network.sector is None else network.sector.Pi_w
    return number(np.diag(Pi_w))


def links_apart(X: Matrix) -> Matrix:
    """Return the block diagonal form of blocks (q, q) that stand one below the other.

    >>> links_apart(np.array([[1.0], [2.0]])).tolist()
    [[1.0, 0.0], [0.0, 2.0]]
    """
    return block_diagonal(*np.split(X, len(X) // X.shape[1]))


def message_step(loop: SampledLoop, lifted: Lifted) -> tuple[Matrix, Matrix]:
    """Return A_z^ and E^: (x_cl+, eps+) = A_z^ (z, zeta1) + E^ w_d."""
    A_z, Y, n = step_matrix(loop, lifted), loop.differences[:, : loop.n_x], loop.n_x
    change = A_z.copy()
    change[:, :n] = change[:, :n] - eye(n, A_z)
    late = np.vstack([zeros(n, len(Y), A_z), eye(len(Y), A_z)])
    step = np.hstack([np.vstack([A_z, -balls.product(Y, change)]), late])
    enters = eye(n, A_z)[:, : loop.n_d]
    return step, np.vstack([enters, -Y[:, : loop.n_d]])


def Omega_1(
    loop: SampledLoop,
    lifted: Lifted,
    messages: Messages,
    witness: MessageWitness,
    running: Matrix | None = None,
) -> Matrix:
    """Assemble Omega_1 in doubles or in balls; running: a cost of z at each sampling instant."""
    number = converter(is_exact(loop.held))
    P, Gamma, X, kappa, decay = (
        number(np.asarray(one))
        for one in (witness.P, witness.Gamma, witness.X, [witness.kappa], [witness.decay])
    )
    n, n_z, links, D = loop.n_x, loop.n_z, len(loop.differences), messages.age
    step, enters = message_step(loop, lifted)
    Pi = zeros(n_z + links, n_z + links, loop.held)
    Pi[:n_z, :n_z] = stored_matrix(loop, witness.prices(loop), running) - balls.product(
        loop.start.T, lifted.CC_d, loop.start
    )
    late, unit = links_apart(X), eye(links, X)
    own = zeros(links, n_z + links, loop.held)
    own[:, loop.messages] = unit
    apart, both = own.copy(), unit
    apart[:, n_z:] = -unit
    if D and witness.seconds:
        _, change, whole = (links_apart(number(one)) for one in witness.seconds)
        late, apart, both = block_diagonal(late, whole), np.vstack([apart, own]), np.vstack([unit, unit])
        P = block_diagonal(P, D * D * decay[0] ** -D * change)
        moved = -step[n:]
        moved[:, n_z:] = moved[:, n_z:] + unit
        step, enters = np.vstack([step, moved]), np.vstack([enters, -enters[n:]])
    charged = balls.product(late, both)
    Pi = Pi + balls.product(apart.T, late - balls.product(charged, charged.T) / kappa[0], apart)
    known = np.r_[0:n, n_z : n_z + links]
    Pi[np.ix_(known, known)] = Pi[np.ix_(known, known)] + Gamma
    kept = np.delete(np.arange(n_z + links), loop.outputs)
    side = balls.product(P, step[:, kept])
    into = balls.product(P, enters)
    corner = P - balls.product(into, lifted.BB_d, into.T)
    return np.block([[Pi[np.ix_(kept, kept)], side.T], [side, corner]])


def Omegas_2(
    loop: SampledLoop, messages: Messages, witness: MessageWitness, running: Matrix | None = None
) -> Iterator[Matrix]:
    """Yield what is to be positive: Omega_2 at the corners, or the coefficients where the links lose alike."""
    links = len(witness.X) // witness.X.shape[1]
    found = (Omega_2(loop, messages, witness, parts, running) for parts in messages.losses(links))
    if not messages.alike(links):
        yield from found
        return
    first, middle, last = found
    yield from (first, 2 * middle - (first + last) / 2, last)


def Omega_2(
    loop: SampledLoop,
    messages: Messages,
    witness: MessageWitness,
    parts: Annotated[np.ndarray, " links"],
    running: Matrix | None = None,
) -> Matrix:
    """Assemble Omega_2 with p_e = parts_e p0, in the loop's numbers, on (x_cl, eps, eta, nu); running: as in `Omega_1`."""
    number = converter(is_exact(loop.held))
    P, Gamma, X = (number(one) for one in (witness.P, witness.Gamma.copy(), witness.X))
    decay, loss = number(np.array([witness.decay, messages.loss]))
    n, links, q, D = loop.n_x, len(X), X.shape[1], messages.age
    p = (loss * number(np.repeat(parts, q)))[:, None]
    unit, none = eye(links, P), zeros(links, n, P)
    Y_nu = loop.differences[:, loop.outputs] if running is not None else unit[:, :0]
    read, late, noise = np.hstack([unit, Y_nu]), slice(n + links, n + 2 * links), n + 2 * links
    size = noise + Y_nu.shape[1]
    if D and witness.seconds:
        Gamma[n:, n:] = Gamma[n:, n:] + (D + 1) * decay**-D * links_apart(number(witness.seconds[0]))
    mean = np.vstack([eye(size, P)[:n], np.hstack([none, p * unit, (1 - p) * read])])
    apart = np.hstack([none, unit, -read])
    spread = p * (1 - p) * links_apart(np.vstack(_blocks(Gamma[n:, n:], q)))
    if D:
        spread = spread + (1 - p) * D * D * decay ** (1 - D) * links_apart(X)
    rest = size - len(P)
    Omega: Matrix = block_diagonal(decay * P, zeros(rest, rest, P)) - balls.product(mean.T, Gamma, mean)
    Omega = Omega - balls.product(apart.T, spread, apart)
    Omega[late, late] = Omega[late, late] + decay * links_apart(number(witness.X_jitter))
    if running is not None:
        Omega[noise:, noise:] = Omega[noise:, noise:] - running[loop.outputs, loop.outputs]
    kept = np.arange(size) if messages.jitter else np.delete(np.arange(size), late)
    within: Matrix = Omega[np.ix_(kept, kept)]
    return within


def _blocks(form: Matrix, q: int) -> list[Matrix]:
    """Return the blocks (q, q) on the diagonal."""
    return [form[k : k + q, k : k + q] for k in range(0, len(form), q)]
