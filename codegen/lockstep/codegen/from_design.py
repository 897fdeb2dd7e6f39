"""From a design file to the specification of the C: controllers, Laplacian rows, and the datasheet's figures."""

import hashlib
import json
import math

import numpy as np

from lockstep.check.sampled.controller import PRECISIONS
from lockstep.codegen.sampled_design import HeldVerdict
from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant, Neighbour, Optimize, Signal
from lockstep.lmi.certify import Verdict
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import SampledVerdict

CONTINUOUS_ONLY = (
    "the continuous controller in real arithmetic; the sampled, rounded one of this folder is not covered yet"
)


def specification(
    stored: Stored,
    verdict: Verdict,
    *,
    optimize: Optimize = "speed",
    held: HeldVerdict | None = None,
    name: str = "",
    prefix: str = "",
) -> CodegenSpec:
    """Return what to generate for a stored design.

    Args:
        stored: the design.
        verdict: what the checker says of it just now; what the file says of itself does not count.
        optimize: "speed" or "size".
        held: what is proved of the numbers that will be printed, sampled and rounded; None: nothing.
        name: of the folder's target and umbrella header; "": the agent's, and `_controllers`.
        prefix: put before the agent's name in all that is generated.
    """
    problem, agent = stored.problem, stored.problem.agent()
    graph, lure, x0 = problem.graph(), agent.lure, problem.initial_states()
    names = [f"{prefix}{agent.name}{i}" for i in range(1, graph.N + 1)]
    units = agent.units
    sources: list[list[Neighbour]] = [[] for _ in names]
    for listener, source, weight in graph.edges:
        sources[listener - 1].append(Neighbour(names[source - 1], weight))
    signals = {
        "outputs": tuple(Signal(name, units.get(name, "")) for name in agent.outputs),
        "inputs": tuple(Signal(name, units.get(name, "")) for name in agent.inputs),
    }
    gains = stored.gains
    controllers = tuple(
        Controller(name, gains.A[i], gains.B[i], gains.C[i], gains.D[i], tuple(sources[i]), **signals)
        for i, name in enumerate(names)
    )
    plants = tuple(
        LinearPlant(lure.A, B, lure.C, np.asarray(x0[i])) for i, B in enumerate(problem.agents_B())
    )
    table = problem.controller
    return CodegenSpec(
        agents=controllers,
        period=table.period,
        delay=table.delay,
        discretization=table.discretization,
        real=table.real,
        optimize=optimize,
        name=name or f"{prefix}{agent.name}_controllers",
        prefix=prefix,
        title=problem.title,
        certificate=_datasheet(stored, verdict, held),
        design_hash=fingerprint(stored),
        plants=plants,
    )


def fingerprint(stored: Stored) -> str:
    """Return the SHA-256 of a design file's content, whatever the order of its keys."""
    text = json.dumps(stored.document(), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _datasheet(
    stored: Stored, verdict: Verdict, held: HeldVerdict | None
) -> dict[str, str | float | bool | None]:
    if not verdict.certified or stored.proofs.certificate is None:
        return {"certified": False}
    delta = {f"delta_{letter}": value for letter, value in stored.claims.fragility.items() if value}
    covered = held is not None and held.verdict.certified
    lines = signed_lines(held.verdict, stored) if held and covered else {"covers": CONTINUOUS_ONLY}
    if verdict.scope == "local":
        said = "assumes" if "assumes" in lines else "covers"
        lines = {**lines, said: f"{lines[said]}; {_domain(stored)}"}
    return {
        "certified": True,
        "proof": "ball" if covered else "exact",
        **lines,
        "scope": verdict.scope,
        "rho": stored.proofs.certificate.rho,
        **({"rho_sampled": held.rho.rho if held.rho else "not proved"} if held and covered else {}),
        "alpha": stored.claims.alpha,
        **delta,
        **({"rho and delta are": "of the continuous controllers (proof: exact)"} if covered else {}),
    }


def _domain(stored: Stored) -> str:
    """Return the assumption of a local certificate, on the states of [agent.domain]."""
    sides = ", ".join(
        f"{low:g} <= {name} <= {high:g}" for name, (low, high) in stored.problem.agent().domain.items()
    )
    return f"every agent stays in its domain ({sides}), which is not proved of sampled controllers"


def signed_lines(sampled: SampledVerdict, stored: Stored) -> dict[str, str]:
    """Return what is proved of the sampled controllers, under which assumptions, and what remains."""
    real = stored.problem.controller.real
    applied = "one period after its sample" if sampled.delay else "at once"
    unit = PRECISIONS[real].u
    return {
        "proved": f"all agents come to agree, between the samples too, under these {real} controllers stepped every"
        f" {sampled.period!r} s with u held, every rounding of a step counted",
        "assumes": f"the agents obey their model with slopes up to {_slopes(stored)}; all step at one instant; every message"
        f" arrives; u acts {applied} and unclipped; no step overflows",
        "remains": "at the sampling instants, in the end, a distance of the states from agreement of up to"
        f" {_two_digits(sampled.residual)} times the largest error of a message or of an own reading (root mean square:"
        f" {_two_digits(sampled.residual_rms)} times);"
        f" rounding a message to {real} errs by {unit:.1e} of its size",
    }


def _slopes(stored: Stored) -> str:
    return "alpha, and each single slope up to its bound" if stored.claims.entries else "alpha"


def _two_digits(value: float) -> str:
    """Round up to two digits, so that the last bits of a machine's arithmetic do not show.

    >>> _two_digits(4177144.9)
    '4.2e+06'
    """
    if value <= 0 or not math.isfinite(value):
        return f"{value:g}"
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / unit) * unit:.1e}"
