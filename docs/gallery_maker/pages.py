"""The page of a field: its problem, its committed design's claims, and what was measured of it."""

import functools
from typing import Any

import numpy as np

import lockstep
from gallery_maker.measure import NAME, PER_UNIT, design_path, known
from gallery_maker.scenes import SCENES
from lockstep.lmi.analysis.decimals import below
from lockstep.model.problem import Problem
from lockstep.workflow.init import fields, init

AT_LIMIT = 0.95
"""Gains of a norm above this part of their limit are said to be at it."""

SPACE = "\N{NO-BREAK SPACE}"
"""Between a value and its unit."""

SMALL = 1e-3
"""A distance from agreement below this part of the first one is shown as that."""

SCALED = " Nothing here has a unit; the `s` of commands is the model's scaled unit of time."

MOVING = {
    "arms": "The links swing on their joints; the dot on each hub is the motor's angle.",
    "carts": "The leader's cart above, its follower below.",
    "platoon": "Seen from the leader, on the right; the marks are the places. Errors are drawn larger than gaps.",
    "quadrotors": "Seen from the side and from where the first one flies, which is on top.",
}


@functools.cache
def parts(field: str) -> tuple[Problem, lockstep.Design, dict[str, Any]]:
    """Return a field's problem, its committed design, and what was measured of that."""
    return Problem.parse(init(field).text), lockstep.load(design_path(field)), known()[field]


def index() -> str:
    """Return the page that leads to the others."""
    rows = "\n".join(_row(field, *parts(field)) for field in fields())
    listed = "\n".join(fields())
    return f"""# Fields to begin from

`lockstep init FIELD -o problem.toml` writes one of these files, commented, with the schema that editors hold it against
beside it. Parameters are those of the source that the file names, or of its order of magnitude; what is ours is said to be.

<div class="named">

| field | rho of the C, proved | period | flash, at most (fitted) | what it is | agents | states of each | order |
|---|---|---|---|---|---|---|---|
{rows}

</div>

Each page shows a committed design, the run of its C's arithmetic, and what is proved of it. CI proves every one of
them again, compiles its C, compares it with the reference, and runs it. [Notebooks](../notebooks/index.md) walk through five.

```{{toctree}}
:hidden:

{listed}
```
"""


def page(field: str) -> str:
    """Return the page of a field."""
    problem, design, measured = parts(field)
    agent, graph = problem.agent(), problem.graph()
    text = init(field).text
    about = [line.removeprefix("# ") for line in text.splitlines()[1:] if line.startswith("# ")]
    units = units_of(problem)
    states, inputs = (
        ", ".join(f"`{name}` ({units[name]})" if name in units else f"`{name}`" for name in names)
        for names in (agent.states, agent.inputs)
    )
    roots = ", ".join(map(str, graph.roots))
    reach = (
        f"agent {roots} leads" if len(graph.roots) == 1 else f"any of the agents {roots} reaches all others"
    )
    formulas = "\n".join(f"{name}' = {formula}" for name, formula in problem.file.agent.dynamics.items())
    outputs = "\n".join(f"{name} = {formula}" for name, formula in problem.file.agent.outputs)
    values = ", ".join(
        f"{name} = {value:g}" + (f"{SPACE}{units[name]}" if name in units else "")
        for name, value in problem.file.agent.parameters.items()
    )
    return f"""# {problem.title}

{" ".join(about)}

## The agent

States {states}; inputs {inputs}{f"; parameters {values}" if values else ""}.{"" if agent.units else SCALED}

```text
{formulas}
{outputs}
```

## The graph

![{problem.title}: who listens to whom]({field}.svg)

{graph.N} agents; an arrow goes from whom an agent listens to; {reach}.

{_run(field, design, measured)}
{_proved(design, measured["run"]["disagreement"][0])}
{_ships(design, measured)}
## Run it

```sh
lockstep init {field} -o {field}.toml
lockstep check {field}.toml
lockstep build {field}.toml -o {field}
```

`lockstep explain {field}` then says what is proved of it, and `{field}/report.html` shows the run.

## The file

```toml
{text.rstrip()}
```
"""


def units_of(problem: Problem) -> dict[str, str]:
    """Return the units of states, inputs and parameters as they are written."""
    units = problem.file.agent.units
    return {name: "per unit" if unit == PER_UNIT else unit.replace("^2", "²") for name, unit in units.items()}


def _unit(problem: Problem, unit: str) -> str:
    """Return a unit of time behind a value, nothing where the model has no units."""
    return f"{SPACE}{unit}" if problem.agent().units else ""


def _percent(part: float) -> str:
    return f"{100 * part:.2g}{SPACE}%"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _row(field: str, problem: Problem, design: lockstep.Design, measured: dict[str, Any]) -> str:
    cells = (
        f"[{field}]({field}.md)",
        f"{design.sampled['rho']:.4g}",
        f"{problem.controller.period:g}{_unit(problem, 's')}",
        f"{measured['costs']['flash']}{SPACE}B",
        problem.title,
        problem.graph().N,
        problem.agent().n,
        problem.order,
    )
    return "| " + " | ".join(map(str, cells)) + " |"


def _run(field: str, design: lockstep.Design, measured: dict[str, Any]) -> str:
    run, problem = measured["run"], design.problem
    after = f"{problem.simulation.horizon:g}{_unit(problem, 's') or ' units of time'}"
    first, most, last = run["disagreement"]
    ended = f"{last:.2g}" if last > SMALL * first else "less than a thousandth of that"
    swing = f", after at most {most:.3g} on the way" if most > 1.05 * first else ""
    held = (
        f"Its weighted disagreement, in L2, is {run['ratio']:.2g} of the most that is proved to be possible from there."
        if run["covered"] and run["ratio"]
        else "The proof says nothing of the size of this run."
    )
    moving = (
        f"\n![{problem.title}, as they move]({field}-moving.svg)\n\n{MOVING[field]}\n"
        if field in SCENES
        else ""
    )
    units = units_of(parts(field)[0])
    inputs = {units.get(name, "") for name in problem.agent().inputs}
    unit = f"{SPACE}{inputs.pop()}".rstrip(SPACE) if len(inputs) == 1 else ""
    return f"""## The run

The nonlinear loop with the arithmetic of the C, from the file's initial states, undisturbed. The distance from
agreement is {first:.3g} at first and {ended} after {after}{swing}; the largest input is {run["input"]:.3g}{unit}. {held}

![{problem.title}: states of all agents against time]({field}-states.png)

![{problem.title}: distance from agreement against time]({field}-disagreement.png)
{moving}"""


def _proved(design: lockstep.Design, start: float) -> str:
    """Write what is proved; start: how far from agreement the run that is shown begins."""
    claims, problem, sampled = design.stored.claims, design.problem, design.sampled
    scope = "from all states" if claims.scope == "global" else "while each agent stays in its `domain`"
    if np.isfinite(problem.limits).any():
        scope += ", while no input meets its limit"
    rows = [
        (
            "rho",
            f"{design.rho:.4g}",
            "gain from the disagreement of the disturbances and noise to what is weighed (states, controllers, u), in L2",
        )
    ]
    if claims.floor is not None:
        rows.append(
            ("floor", f"{claims.floor:.4g}", "no controllers at all can be certified below it in this way")
        )
    rows.append(
        (
            "alpha",
            f"{design.alpha:.4g}",
            "the largest slope of the nonlinearity beside its linear part, proved",
        )
    )
    if claims.decay is not None:
        rows.append(
            ("decay", f"{claims.decay:.3g}{_unit(problem, '1/s')}", "of every disagreement, undisturbed")
        )
    rows.append(
        (
            "sampled rho",
            f"{sampled['rho']:.4g}",
            f"of the loop that ships: {problem.controller.real}, roundings included",
        )
    )
    if claims.initial_set is not None:
        from_there = (
            "every agent, undisturbed and controllers at rest, from a distance from agreement of at most this, while agent"
            f" {claims.initial_set.leader} stays within `[network]` `leader`: proved of the continuous controllers. The run"
            " above begins at"
        )
        rows.append(
            ("stays in its domain", f"from {below(claims.initial_set.radius)}", f"{from_there} {start:.3g}")
        )
    elif claims.scope == "local":
        rows.append(("stays in its domain", "not claimed", "the run above does"))
    longest = sampled.get("max_period")
    if longest:
        rows.append(
            (
                "longest period",
                f"{longest:.3g}{_unit(problem, 's')}",
                "the longest found at which the same gains, sampled anew, are certified",
            )
        )
    if problem.order:
        stable = "yes" if claims.controllers_stable else "not claimed"
        rows.append(("controllers stable", stable, "each by itself"))
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return f"""## What is proved

All agents agree, {scope}: decided in exact arithmetic for the controllers of the design, and in ball arithmetic for those
that ship. The figures are those of the committed design, which `lockstep certify` decides.

| figure | value | what it is |
|---|---|---|
{table}

{_gains(design)}
"""


def largest(design: lockstep.Design) -> float:
    """Return the largest norm |[A_i B_i; C_i D_i]| of the controllers, in the units of their limit."""
    return max(design.problem.gain_norms(design.stored.gains.blocks))


def _gains(design: lockstep.Design) -> str:
    norm, limit, floor = largest(design), design.problem.design.gain_limit, design.floor
    if design.problem.design.method == "given":
        return f"The gains are those of the file: only their certificate was searched for. Their largest norm is {norm:.3g}."
    size = f"The largest norm of a controller's gains is {norm:.3g}; their limit is {limit:g}"
    figures = design.stored.info.get("figures", {}).get("defaults", {})
    given_up = figures.get("given_up")
    raised = f" (before that: {given_up})" if given_up else ""
    chosen = "chosen by default" if figures else "the file's"
    if norm < AT_LIMIT * limit:
        return f"{size}, {chosen}{raised}: it does not bind."
    won = (
        ""
        if floor is None
        else f" Without any limit rho could be {_percent(1 - floor / design.rho)} smaller at the very most: its floor."
    )
    return (
        f"{size}, {chosen}{raised}: it binds, and on purpose. Larger gains lower rho, and pay with inputs and noise that rho"
        f" weighs little.{won}"
    )


def _ships(design: lockstep.Design, measured: dict[str, Any]) -> str:
    table, costs, steps = design.problem.controller, measured["costs"], measured["instructions"]
    late = ", the output one period after the reading" if table.delay else ""
    operations = " and ".join(_count(costs[f"{what}s"], what) for what in ("multiplication", "addition"))
    per_step = f"{steps[0]}" if steps[0] == steps[1] else f"{steps[0]} to {steps[1]}"
    return f"""## What ships

| the most of any controller | value |
|---|---|
| order | {design.problem.order} |
| period | {table.period:g}{_unit(design.problem, "s")}{late} |
| arithmetic | `{table.real}`, {operations} in a step |
| RAM | {costs["ram"]}{SPACE}bytes |
| stack | at most {costs["stack"]}{SPACE}bytes on a {NAME} |
| flash | at most {costs["flash"]}{SPACE}bytes on a {NAME} |
| a step | {per_step} instructions on an emulated {NAME}, by compiler and level; other versions differ by some |

The C gave the same bits as its reference on this machine and on that core.

"""
