"""From nonlinear agents and a graph to certified H-infinity consensus controllers in embedded C.

The steps, each a function that takes objects or the names of files, and what the command line calls:

    design    a problem (or its file) -> `Design`: gains, proved with those very gains
    load      a design file, or a folder that holds one -> the same object
    certify   the independent checker, of a design or of a folder of generated C
    explain   in plain words: what is proved, what that rests on, what is not proved
    generate  C for each agent, from a certified design only
    verify    compiles the C of a folder and compares it, bit by bit, with the Python reference
    simulate  the nonlinear loop, held against what is proved of it
    build     all of them, and a report

    decide_lmi  a linear matrix inequality with a point, of any origin: `lockstep certify --lmi`

Names are imported when they are first used: `import lockstep` is instant. The parts are in `lockstep.check` (the
checker), `lockstep.model`, `lockstep.lmi`, `lockstep.codegen`, `lockstep.verification`, `lockstep.campaign`,
`lockstep.report`.
"""

import pkgutil
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lockstep.check.errors import ClaimError, LockstepError, ProblemError
    from lockstep.lmi.external_lmi import LmiVerdict, decide_lmi
    from lockstep.model.problem import Problem
    from lockstep.workflow.build import Build, build
    from lockstep.workflow.certify import DesignVerdict, certify
    from lockstep.workflow.design import design
    from lockstep.workflow.design_file import Design, load
    from lockstep.workflow.explain import Explanation, explain
    from lockstep.workflow.generate import Generated, generate
    from lockstep.workflow.runs.simulate import simulate
    from lockstep.workflow.runs.simulation import Simulation
    from lockstep.workflow.verify import verify

# The other roots hold portions of this package: this is the only `__init__` among them.
__path__ = pkgutil.extend_path(__path__, __name__)

__all__ = [
    "Build",
    "ClaimError",
    "Design",
    "DesignVerdict",
    "Explanation",
    "Generated",
    "LmiVerdict",
    "LockstepError",
    "Problem",
    "ProblemError",
    "Simulation",
    "build",
    "certify",
    "decide_lmi",
    "design",
    "explain",
    "generate",
    "load",
    "simulate",
    "verify",
]

_HOMES = {
    "Build": "lockstep.workflow.build",
    "Design": "lockstep.workflow.design_file",
    "DesignVerdict": "lockstep.workflow.certify",
    "Explanation": "lockstep.workflow.explain",
    "Generated": "lockstep.workflow.generate",
    "LmiVerdict": "lockstep.lmi.external_lmi",
    "Problem": "lockstep.model.problem",
    "Simulation": "lockstep.workflow.runs.simulation",
    "decide_lmi": "lockstep.lmi.external_lmi",
    "simulate": "lockstep.workflow.runs.simulate",
    "load": "lockstep.workflow.design_file",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562); a step is in the module of its name, an error in `lockstep.check.errors`."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    default = "lockstep.check.errors" if name.endswith("Error") else f"lockstep.workflow.{name}"
    return getattr(import_module(_HOMES.get(name, default)), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
