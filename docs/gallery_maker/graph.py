"""The graph of a field as SVG."""

import math

from lockstep.model.problem import Problem

RADIUS, NODE, MARGIN = 85, 16, 4
RIM, TIP = NODE + 1, 11
"""Where a circle ends, its line included, and how long the head of an arrow is, which ends there."""


def drawing(problem: Problem) -> str:
    """Return the graph as SVG: agents on a circle, an arrow from whom each listens to."""
    graph = problem.graph()
    angles = [2 * math.pi * k / graph.N for k in range(graph.N)]
    x, y = ([RADIUS * f(angle) for angle in angles] for f in (math.sin, lambda a: -math.cos(a)))
    edge = NODE + MARGIN
    width, height = (max(values) - min(values) + 2 * edge for values in (x, y))
    places = [(a - min(x) + edge, b - min(y) + edge) for a, b in zip(x, y, strict=True)]
    lines, heard = [], {(listener, source) for listener, source, _ in graph.edges}
    for listener, source in sorted(heard):
        (x0, y0), (x1, y1) = places[source - 1], places[listener - 1]
        length = math.hypot(x1 - x0, y1 - y0)
        head = (RIM + TIP) / length
        a, b = head if (source, listener) in heard else RIM / length, 1 - head
        ends = (x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0))
        lines.append(
            '<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}" marker-end="url(#tip)"/>'.format(*ends)
        )
    nodes = [
        f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{NODE}"/><text x="{a:.1f}" y="{b + 5:.1f}">{k}</text>'
        for k, (a, b) in enumerate(places, start=1)
    ]
    size = f'width="{width:.0f}" height="{height:.0f}"'
    body = "\n".join([*lines, *nodes])
    return f"""<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width:.0f} {height:.0f}">
<defs><marker id="tip" markerUnits="userSpaceOnUse" markerWidth="{TIP}" markerHeight="10" refX="0" refY="5" orient="auto">
<path d="M0,0 L{TIP},5 L0,10 z" fill="#3b6ea5"/></marker></defs>
<g stroke="#3b6ea5" stroke-width="2" fill="#ffffff" font-family="sans-serif" font-size="14" text-anchor="middle">
<style>text {{ stroke: none; fill: #1f2d3d; }}</style>
{body}
</g>
</svg>
"""
