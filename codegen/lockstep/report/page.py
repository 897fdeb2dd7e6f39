"""The page: facts and drawings as one HTML file that asks for nothing from anywhere."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex
from markupsafe import Markup

from lockstep.codegen.cost.cores import CORES
from lockstep.codegen.emission.rendering import templates
from lockstep.codegen.folder.guarantee_lines import lines_of
from lockstep.lmi.analysis.decimals import above
from lockstep.lmi.document import answer_document
from lockstep.lmi.specification.defaults import TRIED
from lockstep.model.problem.tables.toml_text import value_text
from lockstep.model.simulation import effort_indices, indices
from lockstep.report import formula
from lockstep.report.certificate_terms import terms_of
from lockstep.report.drawings import Drawings
from lockstep.report.poles import Spectrum
from lockstep.report.report_data import Facts
from lockstep.report.style import DARK, LIGHT, shades
from lockstep.verification.verify import most_of

MOST_AGENTS = 12
"""Agents with a row or a section of their own; of more, the files tell."""

MOST_ENTRIES = 400
"""Of all gain matrices of a page."""

MOST_POLES = 60

_TEMPLATES = templates("lockstep.report", autoescape=True, keep_trailing_newline=False)


def html(facts: Facts, spectrum: Spectrum, drawings: Drawings, files: Sequence[str]) -> str:
    """Return the page.

    Args:
        facts: what is known.
        spectrum: poles and singular values.
        drawings: the figures, written into the page.
        files: the names of all files of the folder.
    """
    problem = facts.problem
    return _TEMPLATES.get_template("report.html.j2").render(
        light=Markup(shades(LIGHT)),
        dark=Markup(shades(DARK)),
        problem=problem,
        agent=problem.agent(),
        graph=problem.graph(),
        design=answer_document(facts.stored),
        sampled=facts.stored.claims.sampled,
        manifest=facts.manifest,
        asked=list(_asked(facts)),
        guarantee=lines_of(facts.manifest.certificate),
        terms=terms_of(facts),
        checks=facts.checks.rows,
        findings=facts.checks.findings,
        verified=facts.verified,
        targets=[_target(target) for target in facts.verified.targets],
        equal=sum(target.bitwise is True for target in facts.verified.targets),
        equations=_equations(facts),
        outputs=_outputs(facts),
        symbol=formula.inline,
        above=above,
        run=_run(facts),
        uncovered=facts.uncovered,
        no_run=facts.no_run,
        drawings=drawings,
        spectrum=spectrum,
        trade_off=facts.trade_off,
        loop_poles=_pole_texts(spectrum.loop),
        controller_poles=[_pole_texts(poles) for poles in spectrum.controllers[:MOST_AGENTS]],
        unstable=_unstable(facts, spectrum),
        cores=_cores(facts),
        gains=_gains(facts),
        agents=facts.manifest.agents[:MOST_AGENTS],
        unnamed=max(0, len(facts.manifest.agents) - MOST_AGENTS),
        files=files,
    )


def _asked(facts: Facts) -> Iterator[tuple[str, str]]:
    """Name and value of what is asked for, in the file or by default: [design] and [agent.limits], as a file has them."""
    tables, figures = facts.problem.document(), facts.stored.info["figures"]
    asked = {
        key: value for key, value in tables["design"].items() if key != "gains" and value not in (None, {})
    }
    limits = {"[agent.limits]": tables["agent"]["limits"]} if tables["agent"].get("limits") else {}
    yield from ((key, value_text(value)) for key, value in (asked | limits).items())
    tried = figures.get("defaults", {})
    yield from ((f"by default, {when}", tried[key]) for key, when in TRIED.items() if tried.get(key))


def _equations(facts: Facts) -> list[tuple[str, Markup, str]]:
    """(state, its equation, the same as text) in the order of the states."""
    table = facts.problem.file.agent
    return [
        (
            state,
            formula.equation(formula.derivative(state), table.dynamics[state]),
            f"d/dt {state} = {table.dynamics[state]}",
        )
        for state in table.states
    ]


def _outputs(facts: Facts) -> list[tuple[str, Markup, str]]:
    return [
        (name, formula.equation(formula.symbol(name), text), f"{name} = {text}")
        for name, text in facts.problem.file.agent.outputs
    ]


def _run(facts: Facts) -> dict[str, Any] | None:
    """Figures of the run, and the indices of the agents."""
    run = facts.trajectory
    if run is None:
        return None
    units, apart = facts.problem.agent().shown_units, run.disagreement_by_state()
    rows = zip(indices(run), effort_indices(run), np.abs(run.u).max(axis=(0, 2)), strict=True)
    return {
        "horizon": run.t[-1],
        "disturbance": _disturbance(facts),
        "whole": run.t[-1] >= facts.problem.simulation.horizon * (1 - 1e-9),
        "apart": ", ".join(
            f"{name} from {a:.3g} to {b:.3g} {units.get(name, '')}".rstrip()
            for name, a, b in zip(run.state_names, apart[0], apart[-1], strict=True)
        ),
        "rows": [
            (f"{run.agent}{i}", one, effort, peak)
            for i, (one, effort, peak) in enumerate(list(rows)[:MOST_AGENTS], start=1)
        ],
    }


def _disturbance(facts: Facts) -> str:
    """What acts on the run, in a sentence."""
    table = facts.problem.simulation.disturbance
    if table.kind in ("none", "worst"):
        return "The leader follows its reference." if facts.problem.reference else "Nothing disturbs it."
    return f"Disturbed by {table.kind}, {table.size}."


def _target(target: Any) -> dict[str, Any]:
    """A target's row; of a compiler's message only what comes before its details, which name places on a machine."""
    equal = "equal" if target.bitwise else "NOT EQUAL"
    said = "skipped" if target.skipped else "failed" if target.error else equal
    why = (target.skipped or target.error).partition(" (")[0].partition("\n")[0]
    return {"row": target, "said": said, "why": why}


def _cores(facts: Facts) -> list[dict[str, Any]]:
    """Per core the largest bounds over the agents, and the largest of what was measured."""
    found = []
    for group, core in CORES.items():
        measured = [t for t in facts.verified.targets if t.core == group]
        found.append(
            {
                "title": core.title,
                "stack": max(agent.stack_budget_bytes[group] for agent in facts.manifest.agents),
                "flash": max(agent.flash_budget_bytes[group] for agent in facts.manifest.agents),
                "instructions": max(agent.instruction_budget[group] for agent in facts.manifest.agents),
                "measured": {
                    key: most_of(measured, key) for key in ("stack_bytes", "text_bytes", "most_instructions")
                },
            }
        )
    return found


def _gains(facts: Facts) -> list[tuple[str, list[tuple[str, Any, Any]]]] | None:
    """Per agent: letter, continuous matrix, sampled matrix; None if that is too much for a page."""
    agents = facts.manifest.agents
    entries = sum(len(row) for agent in agents for M in agent.continuous.values() for row in M)
    if len(agents) > MOST_AGENTS or entries > MOST_ENTRIES:
        return None
    return [
        (
            agent.name,
            [
                (letter, agent.continuous[letter], getattr(agent.sampled, letter).decimal)
                for letter in ("A", "B", "C", "D")
                if any(agent.continuous[letter])
            ],
        )
        for agent in agents
    ]


def _unstable(facts: Facts, spectrum: Spectrum) -> list[str]:
    """Controllers with a pole of their own that does not decay."""
    names = [agent.name for agent in facts.manifest.agents]
    return [
        name
        for name, poles in zip(names, spectrum.controllers, strict=True)
        if len(poles) and poles.real.max() >= 0
    ]


def _pole_texts(poles: Complex[np.ndarray, " k"]) -> list[str]:
    """Poles as text, the slowest first, conjugate pairs together.

    >>> _pole_texts(np.array([-3.0 + 0j, -1.0 + 2.0j, -1.0 - 2.0j]))
    ['−1 ± 2i', '−3']
    """
    rising = sorted(poles, key=lambda p: (-round(p.real, 9), abs(p.imag), p.imag))
    return list(_each_pole(rising))[:MOST_POLES]


def _each_pole(poles: Sequence[complex]) -> Iterator[str]:
    for p in poles:
        if abs(p.imag) <= 1e-9 * abs(p):
            yield f"{p.real:.4g}".replace("-", "−")
        elif p.imag > 0:
            yield f"{p.real:.4g} ± {p.imag:.4g}i".replace("-", "−")
