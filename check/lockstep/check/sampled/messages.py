"""Messages that are lost by chance, lost in bursts, late, or of jittered instants: the sampled loop with what listeners hold.

Listener i holds of source j the difference of stamped outputs, d_e = a_ij (y_i - y_j) of one instant for each link e. What
is assumed of each link, `loss` p0, `burst` b, `delay` up to l periods, `jitter` J:

    h_e(k) = d_e(k) + eta_e(k)  with probability 1 - p_e(k), else h_e(k - 1): chance loses a message, or the newest comes;
             0 <= p_e(k) <= p0 depends on what happened before in any way, and given that the links are independent;
    held   = h_e(k - tau_e(k)),  0 <= tau_e(k) <= D = b + l in any pattern: b lost in a row, and then up to l periods late;
    eta_e  = the change of d_e over at most the last J T before the instant at which it was to be read.

So without `loss` the ages are at most D; with it, what chance spares, or something newer, is known D periods later. At
the start h(-1) is any vector that was held for ever: V counts it, and 0 stands for "nothing arrived yet".

With eps(k) = h(k - 1) - d(k) beside xi, nu1(k) = h(k) - d(k) and nu(k) = held - d(k), which is in the place of the
messages' errors of `loop`,

    eps+ = nu1 - Y (xi+ - xi),       nu1_e = delta_e eps_e + (1 - delta_e) eta_e,   delta_e = 1 with probability p_e,
    nu   = nu1 + w,   w(k) = h(k - tau) - h(k) = -sum_{s < tau} g(k - s),
    g_e  = h_e(k) - h_e(k - 1) = (1 - delta_e) (eta_e - eps_e).

Age: by Cauchy and Schwarz w'X w <= D sum_{s < D} g(k - s)'X g(k - s), for every X >= 0 of the size of an output, one for
each link (Kao and Rantzer 2007: a gain of D). With S(k) = c sum_{s=1}^{D-1} (D - s) decay^s g(k - s)'X g(k - s) and
c = D decay^-D,

    S(k + 1) - decay S(k) = c decay (D g(k)'X g(k) - sum_{s<D} decay^s g(k - s)'X g(k - s))
                         <= D^2 decay^(1 - D) g(k)'X g(k) - w(k)'X w(k).

What chance held back is a jump when it is let go, which D g counts too often. So a second bound may stand beside the first:
nu = w_a + w_b, w_a(k) = nu1(k - tau) and w_b(k) = d(k - tau) - d(k) = -sum_{s < tau} v(k - s), v(k) = d(k) - d(k - 1). Then
w_a'Xa w_a <= sum_{s <= D} nu1(k - s)'Xa nu1(k - s), and w_b'Xb w_b <= D sum_{s < D} v(k - s)'Xb v(k - s) as above. The same
sums as S, over D + 1 periods and up to v(k), turn these into

    (D + 1) decay^(-D) nu1'Xa nu1 - w_a'Xa w_a,     D^2 decay^(-D) v+'Xb v+ - w_b'Xb w_b,     v+ = Y (xi+ - xi),

and w_a'Xa w_a + w_b'Xb w_b >= nu'Xs nu wherever [Xa - Xs, -Xs; -Xs, Xb - Xs] >= 0. At the start d was d(0) for ever, nu1 was
eps(0), and the sum of it counts.

Jitter: |eta_e(k + 1)|^2 in the form Xj <= J T int (Y x_d')'Xj (Y x_d') dt over the period before (Cauchy and Schwarz), a way
out of the period that is lifted; what decays is V + eta'Xj eta + S. Readings of two agents for one instant that are s seconds
apart differ from this by at most s |y'|: an error of the message, as any other, that kappa counts.

The proof has two halves, with a form Gamma on (xi, nu1) between them. First, for every rounding, underflow and
nonlinearity, with z^ = (z, nu1) and the step (xi+, eps+) = N^ z^ + J^ w_d,

    V(xi+, eps+) + J T int |Y x_d'|_Xj^2 + D^2 decay^(-D) v+'Xb v+
        < (xi, nu1)'Gamma (xi, nu1) + w'X w + nu'Xs nu + kappa |error|^2 + kappa_mu |mu|^2,

by W_1 > 0, a Schur complement as in `inequality`; with (nu - nu1, nu) = (w, w_a + w_b) + E error, the form
R - R E E'R / kappa of it, R = diag(X, Xs), E = [I; I], is below the least of the right side. It holds for each outcome of
delta, before it is averaged. Second, the mean over delta,

    E ((xi, nu1)'Gamma (xi, nu1) + (D + 1) decay^(-D) nu1'Xa nu1 + D^2 decay^(1 - D) g'X g)
        < decay (V(xi, eps) + eta'Xj eta):                                                         W_2 > 0,

given what happened before, E of a square being that of the mean and p_e (1 - p_e) (eps_e - eta_e)'Gamma_ee (eps_e - eta_e)
for each link. As delta_e^2 = delta_e, what is averaged is affine in each delta_e, so that W_2 is affine in each p_e: between
its values at p_e = 0 and p_e = p0, the other probabilities being what they are. Nothing else depends on p, not V, not S, so

    W_2 > 0 at the 2^links corners p_e in {0, p0}

proves it at every instant, whatever the p_e(k) up to p0 are. With more than `MOST_LINKS` links it is proved of links that
lose alike, p_e(k) = p(k): W_2 is of degree 2 in p then, and positive on [0, p0] where its coefficients of Bernstein are,

    W_2(0),   2 W_2(p0 / 2) - (W_2(0) + W_2(p0)) / 2,   W_2(p0).

With p0 = 0 nothing is random, and the decay is that of each run; with p0 > 0 it is that of the mean square, and with
probability 1 there is agreement as well. With rho, both halves hold with decay 1 and the cost of `l2_gain`. The outputs'
own noise n is then in what is read, eta_e + Y_n n in the place of eta_e with Y_n its columns of `differences`, and nowhere
else: W_1 has no column of it (nu holds what was read), and rho^2 T n'(S (x) I) n stands on the right of the second half.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import Matrix, block_diagonal, converter, exactly, eye, is_exact, zeros
from lockstep.check.sampled import balls
from lockstep.check.sampled.conjugate_points import no_conjugate_point
from lockstep.check.sampled.controller import SampledNetwork
from lockstep.check.sampled.inequality import multiplier, step_matrix, stored_matrix
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.lifting import Lifted, lift
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
            balls.is_positive_definite(one) for one in every_W_2(exact_loop, messages, witness, running)
        ):
            return False
        A, B, EE, FF = parts
        if not no_conjugate_point(A, EE, FF[: len(A), : len(A)], exact_loop.network.period):
            return False
        lifted = lift(A, B, EE, FF, exact_loop.network.period)
        return balls.is_positive_definite(W_1(exact_loop, lifted, messages, witness, running))


def period_parts(
    loop: SampledLoop,
    messages: Messages,
    witness: MessageWitness,
    M: Matrix,
    weights: Performance | None = None,
    rho: float | None = None,
) -> tuple[Matrix, Matrix, Matrix, Matrix] | None:
    """Return A, B, E E' and F'F of one period of x_d, F'F on (x_d, v), for `lift`; None where jitter has too much weight.

    With prices R_w of w = (phi, xi) and Xi = J T Xj on Y x_d' = Y (A x_d + B v + E w), completing the square in w gives

        R = R_w - (Y E)'Xi Y E > 0,   w = w^ + R^-1 (Y E)'Xi Y [A B] a,
        [A B] + E R^-1 (Y E)'Xi Y [A B],   E R^-1 E',   F'F + [A B]'Y'(Xi + Xi Y E R^-1 (Y E)'Xi) Y [A B].
    """
    network, number = loop.network, converter(is_exact(loop.held))
    unit, plant = eye(network.d.N - 1, M), network.plant
    flow = np.hstack([np.kron(unit, plant.A), np.kron(unit, loop.into)])
    GG, HH = network.squares
    E, price = np.kron(unit, plant.G), np.kron(M, _component_prices(network))
    if not GG.any():
        E, price = E[:, :0], price[:0, :0]
    FF = np.kron(M, HH)
    if weights is not None and rho is not None:
        scales = weights.states if len(weights.states) else np.ones(len(GG))
        E = np.hstack([E, np.kron(unit, number(np.diag(scales)))])
        square = number(np.array([rho]))[0] ** 2 * np.kron(network.d.S, eye(len(GG), M))
        price = block_diagonal(price, square)
        FF = FF + np.kron(network.d.S, number(weights.R))
    FF = _padded(FF, flow.shape[1])
    if messages.jitter:
        part, T = number(np.array([messages.jitter, network.period]))
        Xi, Y = part * T * links_apart(number(witness.X_jitter)), loop.differences[:, : loop.n_d]
        YE, rates = balls.product(Y, E), balls.product(Y, flow)
        price = price - balls.product(YE.T, Xi, YE)
        if is_exact(price) and not balls.is_positive_definite(price):
            return None
        back = balls.product(balls.inverse(price), YE.T, Xi, rates)
        FF = FF + balls.product(rates.T, Xi, rates + balls.product(YE, back))
        flow = flow + balls.product(E, back)
    n = loop.n_d
    return flow[:, :n], flow[:, n:], balls.product(E, balls.inverse(price), E.T), (FF + FF.T) / 2


def _component_prices(network: SampledNetwork) -> Matrix:
    """Return the price of phi of one agent: Q of a sector, else I."""
    number = converter(is_exact(network.plant.A))
    Q = np.ones(network.plant.G.shape[1]) if network.sector is None else network.sector.Q
    return number(np.diag(Q))


def _padded(form: Matrix, size: int) -> Matrix:
    out = zeros(size, size, form)
    out[: len(form), : len(form)] = form
    return out


def links_apart(X: Matrix) -> Matrix:
    """Return the block diagonal form of blocks (q, q) that stand one below the other.

    >>> links_apart(np.array([[1.0], [2.0]])).tolist()
    [[1.0, 0.0], [0.0, 2.0]]
    """
    return block_diagonal(*np.split(X, len(X) // X.shape[1]))


def message_step(loop: SampledLoop, lifted: Lifted) -> tuple[Matrix, Matrix]:
    """Return N^ and J^: (xi+, eps+) = N^ (z, nu1) + J^ w_d."""
    N, Y, n = step_matrix(loop, lifted), loop.differences[:, : loop.n_xi], loop.n_xi
    change = N.copy()
    change[:, :n] = change[:, :n] - eye(n, N)
    late = np.vstack([zeros(n, len(Y), N), eye(len(Y), N)])
    step = np.hstack([np.vstack([N, -balls.product(Y, change)]), late])
    enters = eye(n, N)[:, : loop.n_d]
    return step, np.vstack([enters, -Y[:, : loop.n_d]])


def W_1(
    loop: SampledLoop,
    lifted: Lifted,
    messages: Messages,
    witness: MessageWitness,
    running: Matrix | None = None,
) -> Matrix:
    """Assemble W_1 in doubles or in balls; running: a cost of z at each sampling instant."""
    number = converter(is_exact(loop.held))
    P, Gamma, X, kappa, decay = (
        number(np.asarray(one))
        for one in (witness.P, witness.Gamma, witness.X, [witness.kappa], [witness.decay])
    )
    n, n_z, links, D = loop.n_xi, loop.n_z, len(loop.differences), messages.age
    step, enters = message_step(loop, lifted)
    Z = zeros(n_z + links, n_z + links, loop.held)
    Z[:n_z, :n_z] = stored_matrix(loop, witness.prices(loop), running) - balls.product(
        loop.start.T, lifted.Q, loop.start
    )
    R, unit = links_apart(X), eye(links, X)
    own = zeros(links, n_z + links, loop.held)
    own[:, loop.messages] = unit
    apart, both = own.copy(), unit
    apart[:, n_z:] = -unit
    if D and witness.seconds:
        _, change, late = (links_apart(number(one)) for one in witness.seconds)
        R, apart, both = block_diagonal(R, late), np.vstack([apart, own]), np.vstack([unit, unit])
        P = block_diagonal(P, D * D * decay[0] ** -D * change)
        moved = -step[n:]
        moved[:, n_z:] = moved[:, n_z:] + unit
        step, enters = np.vstack([step, moved]), np.vstack([enters, -enters[n:]])
    charged = balls.product(R, both)
    Z = Z + balls.product(apart.T, R - balls.product(charged, charged.T) / kappa[0], apart)
    known = np.r_[0:n, n_z : n_z + links]
    Z[np.ix_(known, known)] = Z[np.ix_(known, known)] + Gamma
    kept = np.delete(np.arange(n_z + links), loop.outputs)
    side = balls.product(P, step[:, kept])
    into = balls.product(P, enters)
    corner = P - balls.product(into, lifted.S, into.T)
    return np.block([[Z[np.ix_(kept, kept)], side.T], [side, corner]])


def every_W_2(
    loop: SampledLoop, messages: Messages, witness: MessageWitness, running: Matrix | None = None
) -> Iterator[Matrix]:
    """Yield what is to be positive: W_2 at the corners, or the coefficients where the links lose alike."""
    links = len(witness.X) // witness.X.shape[1]
    found = (W_2(loop, messages, witness, parts, running) for parts in messages.losses(links))
    if not messages.alike(links):
        yield from found
        return
    first, middle, last = found
    yield from (first, 2 * middle - (first + last) / 2, last)


def W_2(
    loop: SampledLoop,
    messages: Messages,
    witness: MessageWitness,
    parts: Annotated[np.ndarray, " links"],
    running: Matrix | None = None,
) -> Matrix:
    """Assemble W_2 with p_e = parts_e p0, in the numbers of the loop, on (xi, eps, eta, n); running: as in `W_1`."""
    number = converter(is_exact(loop.held))
    P, Gamma, X = (number(one) for one in (witness.P, witness.Gamma.copy(), witness.X))
    decay, loss = number(np.array([witness.decay, messages.loss]))
    n, links, q, D = loop.n_xi, len(X), X.shape[1], messages.age
    p = (loss * number(np.repeat(parts, q)))[:, None]
    unit, none = eye(links, P), zeros(links, n, P)
    Y_n = loop.differences[:, loop.outputs] if running is not None else unit[:, :0]
    read, late, noise = np.hstack([unit, Y_n]), slice(n + links, n + 2 * links), n + 2 * links
    size = noise + Y_n.shape[1]
    if D and witness.seconds:
        Gamma[n:, n:] = Gamma[n:, n:] + (D + 1) * decay**-D * links_apart(number(witness.seconds[0]))
    mean = np.vstack([eye(size, P)[:n], np.hstack([none, p * unit, (1 - p) * read])])
    apart = np.hstack([none, unit, -read])
    spread = p * (1 - p) * links_apart(np.vstack(_blocks(Gamma[n:, n:], q)))
    if D:
        spread = spread + (1 - p) * D * D * decay ** (1 - D) * links_apart(X)
    W: Matrix = _padded(decay * P, size) - balls.product(mean.T, Gamma, mean)
    W = W - balls.product(apart.T, spread, apart)
    W[late, late] = W[late, late] + decay * links_apart(number(witness.X_jitter))
    if running is not None:
        W[noise:, noise:] = W[noise:, noise:] - running[loop.outputs, loop.outputs]
    kept = np.arange(size) if messages.jitter else np.delete(np.arange(size), late)
    within: Matrix = W[np.ix_(kept, kept)]
    return within


def _blocks(form: Matrix, q: int) -> list[Matrix]:
    """Return the blocks (q, q) on the diagonal."""
    return [form[k : k + q, k : k + q] for k in range(0, len(form), q)]
