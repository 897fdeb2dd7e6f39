"""What phi's arguments v = H x are, in the names of the states."""

from lockstep.check.wording import shorten
from lockstep.model.agents.agent import Agent


def arguments_text(agent: Agent) -> str:
    """Return what phi's arguments v = H x are, in the names of the states, for messages.

    >>> arguments_text(Agent.from_expressions("pair", states=["a", "b"], inputs=["f"], outputs={"y1": "a"},
    ...                                       dynamics={"a": "f", "b": "sin(a - 2*b)"}))
    'v1 = a - 2*b'
    """
    return shorten(", ".join(f"v{k} = {text}" for k, text in enumerate(argument_texts(agent), start=1)), 200)


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
