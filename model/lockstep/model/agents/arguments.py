"""What phi's arguments v = H x are, in the names of the states."""

from collections.abc import Iterable

from lockstep.check.wording import shorten
from lockstep.model.agents.agent import Agent


def arguments_text(agent: Agent) -> str:
    """Return what phi's arguments v = H x are, in the names of the states, for messages.

    >>> arguments_text(Agent.from_expressions("pair", states=["a", "b"], inputs=["f"], outputs={"y1": "a"},
    ...                                       dynamics={"a": "f", "b": "sin(a - 2*b)"}))
    'v1 = a - 2*b'
    """
    return shorten(", ".join(f"v{k} = {text}" for k, text in enumerate(argument_texts(agent), start=1)), 200)


def units_text(scales: Iterable[Iterable[float]]) -> str:
    """Return the scales D_w and D_v with |D_w^-1 J D_v| <= alpha, for messages; nothing where they are ones.

    >>> units_text([(0.5, 2.0), (1.0,)]), units_text([(1.0,), (11.0,)]), units_text([(1.0,), (1.0,)])
    ('; phi in units of 0.5, 2', '; v in units of 11', '')
    """
    named = {name: list(one) for name, one in zip(("phi", "v"), scales, strict=False)}
    numbers = {name: ", ".join(f"{d:.3g}" for d in one) for name, one in named.items() if {*one} != {1.0}}
    return "".join(f"; {name} in units of {of}" for name, of in numbers.items())


def argument_texts(agent: Agent) -> list[str]:
    """Return each row of H x in the names of the states."""
    texts = []
    for row in agent.lure.H:
        terms = [
            f"{'-' if h < 0 else '+'} {'' if abs(h) == 1 else f'{abs(h):g}*'}{state}"
            for h, state in zip(row, agent.states, strict=True)
            if h
        ]
        text = " ".join(terms)
        texts.append(text[2:] if text.startswith("+") else text.replace("- ", "-", 1))
    return texts
