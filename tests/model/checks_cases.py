"""Agents for the checks that prove, from their equations."""

from lockstep.model.checks.proved.vector_field import Field
from lockstep.model.problem import Problem


def problem(dynamics, domain=None, output=None, **agent):
    return Problem.from_document(
        {
            "agent": {
                "states": list(dynamics),
                "inputs": ["u"],
                "dynamics": dynamics,
                "outputs": {"y1": output or next(iter(dynamics))},
                "domain": {name: list(map(float, ends)) for name, ends in (domain or {}).items()},
                **agent,
            },
            "network": {"agents": 2, "topology": "path"},
        }
    )


def field(dynamics, domain=None, output=None):
    return Field.of(problem(dynamics, domain, output).agent())
