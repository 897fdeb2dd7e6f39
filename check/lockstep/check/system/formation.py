"""A formation: offsets o_i of the states, such that all x_i - o_i are to agree.

With d_i = o_i - o_1 and w_i = x_i - d_i, agent i is

    w_i' = A w_i + B_i u_i + G phi(H w_i + H d_i, t) + offset(t) + A d_i + xi_i,

the equation that it has without offsets where A d_i = 0 and H d_i = 0. A controller is given the sum of

    a_ij (y_i - y_j - C (o_i - o_j)) = a_ij C (w_i - w_j),

so that the whole loop is the one without offsets, sampled or not, and all that is proved of x is proved of w: w_i - w_j is
(x_i - o_i) - (x_j - o_j). With a slope J moved from phi into A it is the same, (A + G J H) d_i = A d_i.
"""

from typing import Annotated

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats, exactly, product
from lockstep.check.system.agent import ExactAgent

WHERE = "[network] offsets"


def check_formation(agent: ExactAgent, offsets: Annotated[np.ndarray, "N n"]) -> None:
    """Decide in rationals that no agent's equation sees the offsets, which are doubles.

    Raises:
        ProblemError: the first term that an offset changes, and by how much.

    >>> cart = ExactAgent.from_texts("cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p"},
    ...                              dynamics={"p": "v", "v": "f - tanh(v)"})
    >>> check_formation(cart, np.array([[0.0, 0.0], [0.1, 0.0]]))
    >>> check_formation(cart, np.array([[0.0, 0.0], [0.1, 0.5]]))
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: [network] offsets, agent 2: ... adds 0.5 to the derivative of `p`; ...
    """
    o = exactly(offsets)
    changed = product(np.vstack([agent.A, agent.H]), (o - o[0]).T)
    said = [f"adds {{:.6g}} to the derivative of `{name}`" for name in agent.states]
    for row in as_floats(agent.H):
        terms = (f"{c:g} {name}" for c, name in zip(row, agent.states, strict=True) if c)
        said.append(f"moves {' + '.join(terms)}, on which a nonlinear term depends, by {{:.6g}}")
    sizes = as_floats(changed)
    for k, i in np.argwhere((changed != 0).T)[:, ::-1]:
        raise ProblemError(
            f"its offset from agent 1 {said[k].format(sizes[k, i])}",
            where=f"{WHERE}, agent {i + 1}",
            expected="A (o_i - o_1) = 0 and H (o_i - o_1) = 0: offsets that leave every agent's equation as it is",
            remedy="set apart states that enter no equation by themselves, such as positions",
        )
