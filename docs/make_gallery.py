"""Write the gallery: a page and a drawing of the graph for each field of `lockstep init`.

    python docs/make_gallery.py

The pages are committed, so that they can be read without the site; tests/test_site.py holds them to the fields.
"""

import math
from pathlib import Path

from lockstep.model.problem import Problem
from lockstep.workflow.init import fields, init

FOLDER = Path(__file__).parent / "gallery"
SIZE, RADIUS, NODE = 240, 85, 16


def files() -> dict[str, str]:
    """Return the files of the gallery by name."""
    made = {"index.md": index()}
    for field in fields():
        problem = Problem.parse(init(field).text)
        made[f"{field}.md"] = page(field, problem)
        made[f"{field}.svg"] = drawing(problem)
    return made


def index() -> str:
    """Return the page that leads to the others."""
    rows = "\n".join(
        f"| [{field}]({field}.md) | {problem.title} | {problem.graph().N} | {problem.agent().n} |"
        for field in fields()
        for problem in [Problem.parse(init(field).text)]
    )
    listed = "\n".join(fields())
    return f"""# Fields to begin from

`lockstep init FIELD -o problem.toml` writes one of these files, commented, with the schema that editors hold it against
beside it. Parameters are those of the source that the file names, or of its order of magnitude; what is ours is said to be.

| field | what it is | agents | states of each |
|---|---|---|---|
{rows}

```{{toctree}}
:hidden:

{listed}
```
"""


def page(field: str, problem: Problem) -> str:
    """Return the page of a field."""
    agent, graph, table = problem.agent(), problem.graph(), problem.controller
    text = init(field).text
    about = [line.removeprefix("# ") for line in text.splitlines()[1:] if line.startswith("# ")]
    units = {
        name: f" ({agent.units[name]})" if name in agent.units else ""
        for name in (*agent.states, *agent.inputs)
    }
    states = ", ".join(f"`{name}`{units[name]}" for name in agent.states)
    inputs = ", ".join(f"`{name}`{units[name]}" for name in agent.inputs)
    roots = ", ".join(map(str, graph.roots))
    reach = (
        f"agent {roots} leads" if len(graph.roots) == 1 else f"any of the agents {roots} reaches all others"
    )
    formulas = "\n".join(f"{name}' = {formula}" for name, formula in problem.file.agent.dynamics.items())
    outputs = "\n".join(f"{name} = {formula}" for name, formula in problem.file.agent.outputs)
    return f"""# {problem.title}

{" ".join(about)}

## The agent

States {states}; inputs {inputs}.

```text
{formulas}
{outputs}
```

## The graph

![who listens to whom]({field}.svg)

{graph.N} agents; an arrow goes from whom an agent listens to; {reach}.

## What is asked

Method `{problem.design.method}`, controllers of order {problem.order}, a gain limit of {problem.design.gain_limit:g}; in C
every {table.period:g} s, in `{table.real}`{", the output one period after the reading" if table.delay else ""}.

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


def drawing(problem: Problem) -> str:
    """Return the graph as SVG: agents on a circle, an arrow from whom each listens to."""
    graph, middle = problem.graph(), SIZE / 2
    places = [
        (
            middle + RADIUS * math.sin(2 * math.pi * k / graph.N),
            middle - RADIUS * math.cos(2 * math.pi * k / graph.N),
        )
        for k in range(graph.N)
    ]
    lines = []
    for listener, source, _ in graph.edges:
        (x0, y0), (x1, y1) = places[source - 1], places[listener - 1]
        length = math.hypot(x1 - x0, y1 - y0)
        a, b = NODE / length, 1 - (NODE + 7) / length
        ends = (x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0))
        lines.append(
            '<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}" marker-end="url(#tip)"/>'.format(*ends)
        )
    nodes = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{NODE}"/><text x="{x:.1f}" y="{y + 5:.1f}">{k}</text>'
        for k, (x, y) in enumerate(places, start=1)
    ]
    body = "\n".join([*lines, *nodes])
    return f"""<svg xmlns="http://www.w3.org/2000/svg" width="{SIZE}" height="{SIZE}" viewBox="0 0 {SIZE} {SIZE}">
<defs><marker id="tip" markerWidth="7" markerHeight="7" refX="0" refY="3" orient="auto">
<path d="M0,0 L7,3 L0,6 z" fill="#3b6ea5"/></marker></defs>
<g stroke="#3b6ea5" stroke-width="2" fill="#ffffff" font-family="sans-serif" font-size="14" text-anchor="middle">
<style>text {{ stroke: none; fill: #1f2d3d; }}</style>
{body}
</g>
</svg>
"""


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, content in files().items():
        (FOLDER / name).write_text(content, encoding="utf-8")
