"""A design in plain words: what is proved of it, under which assumptions, and what is not proved.

Every sentence follows from what the checker decides here and now (`lockstep.certify`). What the file claims and the checker
does not decide stands under "not proved".
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.continuous.initial_set import axes_text
from lockstep.lmi.analysis.decimals import above, below
from lockstep.lmi.diagnosis.open_loop import softer
from lockstep.lmi.initial_set import sampled_rate
from lockstep.model.checks.plausibility import WRONG_SIGN, unstable_alone
from lockstep.model.html_table import html_table
from lockstep.workflow.certify import DesignVerdict, certify
from lockstep.workflow.design_file import Design, slopes_text

TOLD = {"bound", "certificate", "asked", "decay", "controllers_stable", "floor", "initial_set", "code"}
TOLD_OF_WHAT_SHIPS = {"sampled", "sampled_rho", "controllers_stable_sampled", "max_period", "limits"}
"""Claims of a design file that have sentences of their own below; others are told by the checker's reason."""


@dataclass(frozen=True)
class Statement:
    """A figure and what it means: its name, its value as text, a sentence."""

    name: str
    value: str
    meaning: str

    @property
    def text(self) -> str:
        """The figure and the sentence."""
        return f"{self.value}. {self.meaning}".lstrip(". ")


@dataclass(frozen=True, eq=False)
class Explanation:
    """What a design is worth, for whoever did not make it.

    Args:
        found: what the checker decided.
        proved: what is proved.
        assumed: what that rests on.
        open: what is not proved.
    """

    found: DesignVerdict
    proved: tuple[Statement, ...]
    assumed: tuple[Statement, ...]
    open: tuple[Statement, ...]

    @property
    def ok(self) -> bool:
        """Whether every claim of the design holds."""
        return self.found.ok

    @property
    def parts(self) -> dict[str, tuple[Statement, ...]]:
        """The statements, by what they are."""
        return {"Proved": self.proved, "Assumed": self.assumed, "Not proved": self.open}

    def __repr__(self) -> str:
        """Say all of it, a statement a line."""
        lines = (f"{part}: {one.name}: {one.text}" for part, those in self.parts.items() for one in those)
        return "\n".join((self.found.design.title, *lines))

    def _repr_html_(self) -> str:
        """Return the same as a table, for a notebook."""
        rows = [(part, one.name, one.text) for part, those in self.parts.items() for one in those]
        return html_table(rows, title=self.found.design.title)

    def document(self) -> dict[str, Any]:
        """Return what `lockstep explain --json` prints."""
        return {
            "ok": self.ok,
            "certified": self.found.certified,
            "title": self.found.design.title,
            "reason": self.found.reason,
            **{key.lower().replace(" ", "_"): [*map(asdict, part)] for key, part in self.parts.items()},
        }


def explain(design: Design | Path | str) -> Explanation:
    """Check a design, and say in plain words what that means.

    Args:
        design: itself, its file, or a folder that holds one.

    Raises:
        ProblemError: no design, or a problem in it that cannot be posed.
    """
    found = certify(design)
    if not found.verdict.certified:
        refused = Statement("certificate", "none", f"Nothing is proved of these controllers: {found.reason}.")
        return Explanation(found, (), (), (refused,))
    proved = (*_continuous(found), *_sampled(found), *_others(found))
    return Explanation(found, proved, tuple(_assumed(found)), tuple(_open(found)))


def _continuous(found: DesignVerdict) -> Iterator[Statement]:
    design = found.design
    problem, claims = design.problem, design.stored.claims
    where = (
        "from whatever states they start"
        if found.verdict.scope == "global"
        else "while each stays in its domain"
    )
    where += ", while no input meets its limit" * bool(list(_limits(design)))
    many = problem.spectrum
    said = ", on every connected undirected graph whose nonzero Laplacian eigenvalues are from {:g} to {:g}, switching"
    graphs = "" if many is None else f"{said.format(many.lower, many.upper)} among them"
    yield Statement(
        "agreement",
        f"{problem.graph().N} agents" if many is None else "any number of agents",
        f"All agents come to the same states{graphs}, {where}, with the continuous controllers of the file. Decided in exact"
        " arithmetic for the very gains in it.",
    )
    rho = found.rho
    if rho is not None:
        yield Statement("rho", f"{rho:.6g}", _meaning_of_rho(problem, rho))
    slopes = slopes_text(found.answer)
    yield Statement(
        "alpha",
        design.alpha_text,
        "The agents are linear: no bound is needed."
        if problem.agent().lure.is_linear
        else "The largest slope of the nonlinearity that is counted on, less what of it is in the linear part, proved for its"
        f" formula{f', and so is {slopes}' * bool(slopes)}: every other nonlinearity within these bounds beside that linear"
        " part is covered too.",
    )
    if claims.floor is not None and found.verdict.proves("floor"):
        ratio = 1.0 if rho is None else float(f"{rho / claims.floor:.3g}")
        more = f": this design has {ratio:g} times as much" if ratio != 1 else ""
        yield Statement(
            "lower bound of rho",
            f"{claims.floor:.6g}",
            "With these weights no controllers, of any order and however connected, can be certified below it in this form"
            f" of certificate{more}.",
        )
    if claims.decay is not None and found.verdict.proves("decay"):
        half = math.log(2) / claims.decay
        yield Statement(
            "convergence rate",
            f"{claims.decay:.4g} 1/s",
            f"Without disturbances every disagreement shrinks at least as exp(-{claims.decay:.4g} t) in the long run: by half"
            f" every {half:.3g} s, to a hundredth in {math.log(100) / claims.decay:.3g} s, after an initial transient that"
            " may oscillate; with the continuous controllers.",
        )
    if claims.controllers_stable and found.verdict.proves("controllers_stable"):
        yield Statement(
            "controllers in open loop",
            "stable",
            "Each by itself. Without messages it goes on with the rows it heard last (a node: the differences) and its own"
            " outputs: nothing is proved of an agent so.",
        )
    delta = {letter: value for letter, value in claims.fragility.items() if value}
    if delta:
        shown = ", ".join(f"{letter} {value:g}" for letter, value in delta.items())
        yield Statement(
            "gain uncertainty",
            shown,
            "Spectral norm of the error of each matrix of each controller that is covered, of the continuous controllers.",
        )
    if claims.initial_set is not None and found.verdict.proves("initial_set"):
        yield Statement(
            "initial states",
            f"|x_d(0)| <= {below(claims.initial_set.radius)}",
            f"{found.answer['initial_set']['text']}.",
        )


def _meaning_of_rho(problem: Any, rho: float) -> str:
    states, scales = _disturbed(problem), problem.performance.states
    counted = ", ".join(f"{one:g}" for one in scales[scales > 0][:4])
    scaled = f", each in its scale {counted}" * bool((scales != 1).any())
    weight = problem.design.weights.state
    plain = "" if weight == 1.0 else ", the square of each state times its weight of [design.weights]"
    if problem.order:
        plain += ", the states of the controllers counted with them (`controller` in [design.weights])"
    if problem.performance.outputs.any():
        plain += ", noise of the outputs counted in the scales of [design.disturbances]"
    if problem.design.coordinates != "orthonormal":
        plain += ", both as differences by the rows of L"
    mixed = _mixed(problem, "which states count how much is up to [design.weights]")
    return (
        f"Disturbances that differ between the agents, of root mean square 0.1 (of {', '.join(states[:4])}"
        f"{', ...' if len(states) > 4 else ''}, per second{scaled}), keep them apart by at most {0.1 * rho:.3g} in root mean"
        f" square once the start is forgotten{plain}. Common-mode disturbances do not count.{mixed}"
    )


def _disturbed(problem: Any) -> list[str]:
    scales = problem.performance.states
    return [x for k, x in enumerate(problem.agent().states) if not len(scales) or scales[k]]


def _mixed(problem: Any, so: str) -> str:
    """Say which units a figure adds, and what follows; nothing where it adds one."""
    units = {problem.agent().shown_units.get(name, "") for name in problem.agent().states} - {""}
    return f" This figure adds {', '.join(sorted(units))}: {so}." if len(units) > 1 else ""


def _sampled(found: DesignVerdict) -> Iterator[Statement]:
    sampled, table = found.sampled, found.design.problem.controller
    if sampled.get("certified") is not True:
        return
    delay = "one period after the reading" if table.delay else "at once"
    many = found.design.problem.spectrum
    degree = "" if many is None else f" With at most {many.neighbours} neighbours each."
    yield Statement(
        "period",
        f"{table.period:g} s",
        f"The controllers that ship agree too: {table.real}, stepped {1 / table.period:.6g} times a second, their output held"
        f" and applied {delay}; between the samples as well.{degree} Decided in ball arithmetic.",
    )
    if rate := sampled_rate(table.period, sampled.get("decay"), sampled.get("fastest_decay")):
        yield Statement(
            "convergence rate, sampled",
            f"{rate:g} 1/s",
            "Every disagreement shrinks so from sample to sample in the long run, of the loop that ships, while no input"
            " meets its limit, and but for the rounding of messages.",
        )
    longest = sampled.get("max_period")
    if longest and longest > table.period:
        yield Statement(
            "longest period",
            f"{longest:.4g} s",
            f"The same gains, discretised for it, still agree: {below(longest / table.period, 3)} times the period.",
        )
    if sampled.get("rho") is not None:
        errors = any(found.design.stored.claims.fragility.values())
        said = f"The same gain as rho, of the loop that ships{', without errors of its gains' * errors}."
        yield Statement("rho, sampled", f"{sampled['rho']:.6g}", said)
    if sampled.get("rounding"):
        worst = max(max(one.values()) for one in sampled["rounding"])
        said = "Every rounding of a step counts as an error of the gains of up to this norm, and is covered."
        yield Statement("rounding", above(worst, 2), said)
    residual = sampled.get("residual_rms_per_message_error")
    if residual is not None:
        yield Statement(
            "ultimate bound",
            f"{above(residual, 2)} e",
            "Errors of messages and readings, e the largest of an entry, keep the agents apart by at most this at the"
            " sampling instants, in root mean square: a bound that is not tight."
            f"{_mixed(found.design.problem, 'it says something where states are of size one')}",
        )
    radius = sampled.get("radius")
    if radius is not None:
        limits = ", ".join(f"|{name}| <= {limit:g}" for name, limit in _limits(found.design))
        inside = ", while every agent stays in its domain" if found.verdict.scope == "local" else ""
        agent, a = found.design.problem.agent(), sampled.get("half_axes")
        axes = f", or from {axes_text(a, agent.states, agent.units)}" if a else ""
        yield Statement(
            "no saturation",
            f"{radius:.4g}",
            f"From a disagreement of at most this ({_units(found.design)}){axes}, controllers at rest, nothing disturbing,"
            f" readings exact and every message in time{inside}, no actuator ever meets its limit: {limits}.",
        )


def _limits(design: Design) -> Iterator[tuple[str, float]]:
    problem = design.problem
    for name, limit in zip(problem.agent().inputs, problem.limits, strict=True):
        if math.isfinite(limit):
            yield name, float(limit)


def _units(design: Design) -> str:
    agent = design.problem.agent()
    units = agent.shown_units
    names = [f"{name} in {units[name]}" if name in units else name for name in agent.states]
    return f"the root of the sum of the squares of what each agent is off their mean, {', '.join(names[:6])}"


def _others(found: DesignVerdict) -> Iterator[Statement]:
    agent, claimed = found.design.problem.agent(), found.design.stored.claims.sampled.clipped_half_axes
    for name, verdict in found.verdict.verdicts.items():
        if name not in TOLD | TOLD_OF_WHAT_SHIPS and verdict.proved:
            said = f"{verdict.reason[:1].upper()}{verdict.reason[1:]}."
            if claimed:  # the checker knows no units
                with_units = axes_text(claimed, agent.states, agent.units)
                said = said.replace(axes_text(claimed, agent.states), with_units)
            yield Statement(name.replace("_", " "), "proved", said)


def _assumed(found: DesignVerdict) -> Iterator[Statement]:
    problem = found.design.problem
    yield Statement(
        "model", problem.file.agent.name, "The agents obey the equations of the file, with its parameters."
    )
    if found.verdict.scope == "local":
        sides = ", ".join(
            f"{'-inf' if low is None else f'{low:g}'} <= {name} <= {'inf' if high is None else f'{high:g}'}"
            for name, (low, high) in problem.file.agent.domain.items()
        )
        yield Statement(
            "domain",
            sides,
            "Every agent stays within it; the bound of the nonlinearity is proved there only.",
        )
    if found.sampled.get("certified") is True:
        yield Statement("clock", f"{problem.controller.period:g} s", "All agents step at the same instants.")
        yield Statement(
            "messages",
            "all of them",
            "Every message of a neighbour arrives, but where a statement above names what is lost or late.",
        )
        clipped = ", but where a statement above is of clipped inputs" * found.verdict.proves("clipped")
        yield Statement(
            "actuators",
            "unclipped",
            f"The plant does what u says{clipped}, and no step overflows (`proof/` has Frama-C prove that up to 1e6).",
        )


def _open(found: DesignVerdict) -> Iterator[Statement]:
    from lockstep.codegen.from_design import MOVED, moves_all
    from lockstep.codegen.sensor_noise import noise_on_inputs

    answer, problem = found.answer, found.design.problem
    claimed = found.verdict.failed
    if claimed is not None and (claimed != "sampled" or found.design.stored.claims.sampled.certified):
        said = f"The file claims it and the checker refuses it: {found.reason}"
        if lost := claimed == "messages" and found.design.stored.claims.messages is None:
            said = f"[network.messages] asks for it, and the file does not claim it: {answer['messages']['reason']}"
        yield Statement(claimed, "not claimed" if lost else "refused", f"{said}.")
    if found.sampled.get("certified") is not True:
        yield Statement(
            "sampled controllers",
            "not certified",
            f"Nothing is proved of the controllers that ship: {found.sampled['reason']}.",
        )
    if not found.design.stored.claims.controllers_stable and problem.order:
        yield Statement(
            "controllers in open loop",
            "not claimed",
            "What a controller does when its neighbours fall silent: [design] stable_controllers = true asks for it.",
        )
    if found.design.stored.claims.decay is None:
        yield Statement(
            "decay", "not claimed", "How fast the agents agree: that they do is all that is proved."
        )
    if any(map(math.isfinite, problem.limits)) and found.sampled.get("radius") is None:
        yield Statement(
            "saturation",
            "not claimed",
            "Nothing is proved of when an actuator saturates: smaller gains (`order = 0` where it is higher, a lower"
            " `gain_limit`), or states counted in units in which they are of size one, may change that.",
        )
    figures = found.design.document()["figures"]
    if said := softer(figures):
        yield Statement("constant disturbance", said, "`simulate --controllers off` shows what u = 0 does.")
    if alone := figures.get("rho_alone"):
        yield Statement(
            "open loop",
            f"rho {alone:.4g}",
            "With u = 0, computed: what controllers are worth is how far they are below it.",
        )
    if found.sampled.get("certified") is True and (shown := noise_on_inputs(found.design.stored)):
        yield Statement(
            "sensor noise",
            shown,
            "Root mean square of an input per standard deviation of the noise of an output at each reading, of the agent that"
            " it moves most, near agreement: computed of the linear part.",
        )
    moving = "".join(f"; {row.figure.removesuffix(WRONG_SIGN)}" for row in unstable_alone(problem))
    deaf = np.flatnonzero(problem.graph().in_degrees == 0)
    where = f"that is up to agent {deaf[0] + 1}, which leads" if len(deaf) else "only that they are the same"
    moving += MOVED * moves_all(found.design.stored)
    yield Statement("where they agree", "", f"Which states the agents agree on: {where}{moving}.")
    yield Statement(
        "the C",
        "compared",
        "The compiled code is compared with its reference bit by bit (`lockstep verify`), not proved.",
    )
    if beside := ", ".join(answer.get("not_proved", ())):
        yield Statement("other files", "not proved", f"The proof does not speak of {beside}.")
