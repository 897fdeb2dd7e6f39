"""Agents as they move in a run: SVG with CSS keyframes, no script; it stands still where the reader asks for less motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lockstep.model.simulation.results.trajectory import Trajectory

FRAMES = 90
PLAYED = 9.0
"""Seconds that a scene plays, whatever the run's time."""

WIDTH = 360
COLOURS = ("#0b5cad", "#b93a06", "#13753a", "#7b26c9", "#0d6b86")
DEGREES = 180 / np.pi


@dataclass(frozen=True)
class Body:
    """A drawn part that moves: markup around its own origin, shifts (px) and turns (degrees), parts that ride on it."""

    markup: str
    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray
    parts: tuple["Body", ...] = ()


def arms(run: Trajectory) -> str:
    """The links swing on the joints; the motor's angle is the dot on each hub."""
    shown = _until(run, 6.0)
    bodies = []
    for i, colour in enumerate(COLOURS[: run.N]):
        motor, link = (_of(run, shown, name, i) for name in ("theta_m", "theta_l"))
        still = 0 * link
        hub = Body('<circle r="17"/><circle class="dot" cy="11" r="3.5"/>', still, still, -motor * DEGREES)
        rod = Body(
            f'<path d="M0,0 V76" stroke="{colour}"/><circle cy="76" r="9" fill="{colour}" stroke="none"/>',
            still,
            still,
            -link * DEGREES,
        )
        bodies.append(Body("", still + 70 + 110 * i, still + 40, still, (rod, hub)))
    return _scene(bodies, 150, shown, "three arms: link, and the motor's angle as a dot")


def carts(run: Trajectory) -> str:
    """Carts on a rail each, with the pendulum upright on it."""
    shown = _until(run, 5.0)
    bodies = []
    for i, colour in enumerate(COLOURS[: run.N]):
        p, theta = (_of(run, shown, name, i) for name in ("p", "theta"))
        still = 0 * p
        rod = Body(
            f'<path d="M0,0 V-64" stroke="{colour}"/><circle cy="-64" r="7" fill="{colour}" stroke="none"/>',
            still,
            still,
            theta * DEGREES,
        )
        wheels = '<circle cx="-14" cy="20" r="5"/><circle cx="14" cy="20" r="5"/>'
        cart = f'<rect x="-24" y="0" width="48" height="16" rx="3"/>{wheels}'
        bodies.append(Body(cart, 90 + 350 * p, still + 80 + 110 * i, still, (rod,)))
    rails = "".join(f'<path class="rail" d="M20,{106 + 110 * i} H340"/>' for i in range(run.N))
    return _scene(bodies, 225, shown, "the leader's cart above, its follower below", rails)


def quadrotors(run: Trajectory) -> str:
    """Quadrotors seen from the side, the leader on top; the view flies with the leader."""
    shown = _until(run, 10.0)
    view = _of(run, shown, "x", 0)
    bodies = []
    for i, colour in enumerate(COLOURS[: run.N]):
        x, theta = (_of(run, shown, name, i) for name in ("x", "theta"))
        craft = (
            f'<path d="M-30,0 H30 M-30,0 V-7 M30,0 V-7" stroke="{colour}"/><path d="M-41,-7 H-19 M19,-7 H41"/>'
            f'<circle r="6" fill="{colour}" stroke="none"/>'
        )
        bodies.append(Body(craft, 180 + 250 * (x - view), 0 * x + 40 + 60 * i, -theta * DEGREES))
    middle = '<path class="rail" d="M180,12 V200"/>'
    return _scene(bodies, 210, shown, "seen from where the first one is", middle)


def platoon(run: Trajectory) -> str:
    """Vehicles in a lane, the leader on the right; the view drives with the leader."""
    shown = _until(run, 20.0)
    lead = _of(run, shown, "p", 0)
    bodies = []
    for i, colour in enumerate(COLOURS[: run.N]):
        off = _of(run, shown, "p", i) - lead
        car = (
            f'<rect x="-20" y="-8" width="40" height="12" rx="4" fill="{colour}" stroke="none"/>'
            f'<path d="M-11,-8 L-6,-16 H8 L13,-8" stroke="{colour}"/>'
            '<circle cx="-11" cy="5" r="4.5"/><circle cx="11" cy="5" r="4.5"/>'
        )
        bodies.append(Body(car, 320 - 70 * i + 5 * off, 0 * off + 46, 0 * off))
    places = "".join(f'<path class="rail" d="M{320 - 70 * i},60 v10"/>' for i in range(run.N))
    return _scene(bodies, 95, shown, "the marks are the places; errors are drawn larger than gaps", places)


SCENES: dict[str, Callable[[Trajectory], str]] = {
    "arms": arms,
    "carts": carts,
    "platoon": platoon,
    "quadrotors": quadrotors,
}


def _until(run: Trajectory, last: float) -> np.ndarray:
    """Return the times of the frames, s."""
    return np.linspace(0.0, min(last, float(run.t[-1])), FRAMES)


def _of(run: Trajectory, shown: np.ndarray, name: str, i: int) -> np.ndarray:
    return np.interp(shown, run.t, run.x[:, i, run.state_names.index(name)])


def _scene(bodies: Sequence[Body], height: int, shown: np.ndarray, caption: str, still: str = "") -> str:
    """Return the scene: it plays, waits for a tenth of its time, and begins again."""
    rules: list[str] = []
    drawn = "\n".join(_draw(body, rules) for body in bodies)
    speed = float(shown[-1]) / PLAYED
    words = f"{shown[-1]:g} s, played {speed:.2g} times as fast"
    size = f'width="{WIDTH}" height="{height + 24}"'
    return f"""<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {WIDTH} {height + 24}">
<title>{caption}</title>
<style>
g {{ animation: {PLAYED / 0.9:.4g}s linear infinite; transform-origin: 0 0; }}
.all {{ fill: #fefefe; stroke: #59636e; stroke-width: 3; stroke-linecap: round; animation: none; }}
.rail {{ stroke: #d5dae0; stroke-width: 2; }}
.dot {{ fill: #59636e; stroke: none; }}
text {{ font: 11px sans-serif; fill: #59636e; stroke: none; }}
@media (prefers-reduced-motion: reduce) {{ g {{ animation: none; }} }}
{chr(10).join(rules)}
</style>
<rect {size} fill="#fefefe"/>
<g class="all">{still}
{drawn}
<text x="8" y="{height + 14}">{words}</text>
</g>
</svg>
"""


def _draw(body: Body, rules: list[str]) -> str:
    """Return a body's markup, and append its keyframes; a frame that is as the one before is left out."""
    name = f"b{len(rules)}"
    poses = [
        f"translate({x:.1f}px,{y:.1f}px) rotate({a:.1f}deg)"
        for x, y, a in zip(body.x, body.y, body.angle, strict=True)
    ]
    chosen = [
        k
        for k in range(len(poses))
        if k in (0, len(poses) - 1) or not poses[k - 1] == poses[k] == poses[k + 1]
    ]
    frames = " ".join(f"{90 * k / (len(poses) - 1):.3g}% {{ transform: {poses[k]} }}" for k in chosen)
    moving = len(set(poses)) > 1
    rules.append(
        f".{name} {{ transform: {poses[0]}; {f'animation-name: {name};' if moving else ''} }}"
        + (f"\n@keyframes {name} {{ {frames} 100% {{ transform: {poses[-1]} }} }}" if moving else "")
    )
    inner = "".join(_draw(part, rules) for part in body.parts)
    return f'<g class="{name}">{inner}{body.markup}</g>'
