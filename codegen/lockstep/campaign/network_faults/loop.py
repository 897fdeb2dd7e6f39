"""The closed loop of a folder's nodes over a bad network, as C, compiled once and called for many runs."""

import ctypes
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float, UInt

from lockstep.campaign.compiled.functions import (
    in_scales,
    on_controllers,
    on_disagreement,
    on_inputs,
    plant_slope,
    strays,
)
from lockstep.campaign.compiled.library import FLAGS
from lockstep.campaign.network_faults.faults import NetworkFaults
from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.model.network import Network
from lockstep.verification.closed_loop.software_in_the_loop import sources_in
from lockstep.verification.machines.shared_library import build_library
from lockstep.verification.toolchain import first_compiler

SUBSTEPS = 10
"""Runge-Kutta steps of a period: with jitter, sampling instants are multiples of them."""

COLUMNS = (
    *("z2", "xi2", "disagreement_initial", "disagreement_largest", "disagreement_final"),
    *("faults", "clipped", "outside", "lost", "sent", "stale"),
    *(
        "bad_length",
        "bad_checksum",
        "other_design",
        "unknown_sender",
        "old_number",
        "future",
        "too_old",
        "implausible",
    ),
)
"""Of a run: int |z|^2 and int |xi_d|^2, the disagreement, faulty steps and such that clipped u, Runge-Kutta steps with an
agent out of its domain, messages lost and sent, steps with a stale neighbour, and what was refused, by reason."""

SYMBOL = "lockstep_network_runs"


@dataclass(frozen=True, eq=False)
class NetworkLoop:
    """A compiled loop: `runs` runs it; N, n and the period are the network's."""

    function: Callable[..., None]
    N: int
    n: int
    period: float

    def runs(
        self,
        faults: Float[np.ndarray, "runs faults"],
        seeds: UInt[np.ndarray, " runs"],
        starts: Float[np.ndarray, "runs N n"],
        horizon: float,
        waves: Float[np.ndarray, "runs wave"] | None = None,
    ) -> Float[np.ndarray, "runs columns"]:
        """Return the `COLUMNS` of each run.

        Args:
            faults: rows of `NetworkFaults.row`.
            seeds: of all that a run draws.
            starts: initial states.
            horizon: in s.
            waves: per run a disturbance of every state that is constant, that goes with cos(omega t) and with sin(omega t),
                one after the other, and omega; by default none.
        """
        still = np.zeros((len(seeds), 3 * self.N * self.n + 1)) if waves is None else waves
        out = np.zeros((len(seeds), len(COLUMNS)))
        given = [
            np.ascontiguousarray(one)
            for one in (
                faults.astype(float),
                seeds.astype(np.uint64),
                starts.astype(float),
                still.astype(float),
            )
        ]
        pointers = [one.ctypes.data for one in (*given, out)]
        self.function(len(seeds), int(np.ceil(horizon / self.period)), *pointers)
        return out


def network_loop(
    network: Network, files: Mapping[str, str], weights: Performance, delay: int = 0
) -> NetworkLoop:
    """Compile the loop of a network with the nodes of a folder that has `messages/`.

    Args:
        network: the agents and their graph.
        files: of the folder, relative path -> text.
        weights: what rho is a gain to and from.
        delay: periods after its sample at which u acts.

    Raises:
        ProblemError: no compiler, or a folder without messages.
        ClaimError: the C does not compile.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    if f"messages/{manifest.name}_message.h" not in files:
        raise ProblemError(
            "the folder has no messages/", where="faults", remedy="generate it with `--messages`"
        )
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        place = Path(temporary).resolve()
        for path, text in files.items():
            if path.endswith((".h", ".c")) and path.startswith(("include/", "src/", "messages/")):
                (place / Path(path).name).write_text(text, encoding="utf-8")
        advance = _advance(network, weights, manifest)
        (place / "advance.c").write_text(_generated(advance), encoding="utf-8")
        (place / "network.c").write_text(_source(network, manifest, advance, delay), encoding="utf-8")
        agents = [f"{agent.name}{end}" for agent in manifest.agents for end in (".c", "_node.c")]
        sources = [*agents, f"{manifest.name}_message.c", "network.c", "advance.c"]
        library = build_library(first_compiler("campaign"), (*FLAGS, "-I."), sources, place, "the network")
        function: Any = getattr(ctypes.CDLL(str(library)), SYMBOL)
    function.argtypes = [ctypes.c_int64, ctypes.c_int64, *(ctypes.c_void_p,) * 5]
    function.restype = None
    return NetworkLoop(function, network.N, network.agent.n, manifest.period)


def _advance(network: Network, weights: Performance, manifest: Manifest) -> ca.Function:
    """(x, u, xi, x_C, t) -> (x after a Runge-Kutta step, int |z|^2, int |xi_d|^2 over it, |x_d|^2 and `strays` after)."""
    N, n, m, n_C = network.N, network.agent.n, network.agent.m, manifest.agents[0].order
    x, u, xi = ca.SX.sym("x", n, N), ca.SX.sym("u", m, N), ca.SX.sym("xi", n, N)
    x_C, t = ca.SX.sym("x_C", n_C, N), ca.SX.sym("t")
    h = manifest.period / SUBSTEPS

    def slope(state: ca.SX, time: ca.SX) -> tuple[ca.SX, ca.SX]:
        return (
            ca.reshape(plant_slope(network, state, ca.horzsplit(u), time, xi), n, N),
            on_disagreement(network, state, weights.R) + on_inputs(u, weights.W),
        )

    first, z1 = slope(x, t)
    second, z2 = slope(x + h / 2 * first, t + h / 2)
    third, z3 = slope(x + h / 2 * second, t + h / 2)
    fourth, z4 = slope(x + h * third, t + h)
    after = x + h / 6 * (first + 2 * second + 2 * third + fourth)
    z = h / 6 * (z1 + 2 * z2 + 2 * z3 + z4) + h * on_controllers(x_C, weights.Q)
    inputs = [ca.vec(x), ca.vec(u), ca.vec(xi), ca.vec(x_C), t]
    apart, entered = (on_disagreement(network, one, np.eye(n)) for one in (after, in_scales(xi, weights)))
    return ca.Function(
        "lockstep_advance", inputs, [ca.vec(after), z, h * entered, apart, strays(network, after)]
    )


def _generated(function: ca.Function) -> str:
    generator = ca.CodeGenerator("lockstep_advance", {"with_header": False})
    generator.add(function)
    text: str = generator.dump()
    return text


def _source(network: Network, manifest: Manifest, advance: ca.Function, delay: int) -> str:
    sources = sources_in(manifest)
    links = [(i, j) for i, heard in enumerate(sources) for j in heard]
    offsets = [agent.offsets[0] for agent in manifest.agents if agent.offsets]
    return render(
        "campaign/network.c.j2",
        title=manifest.name,
        agents=manifest.agents,
        N=network.N,
        n=network.agent.n,
        m=network.agent.m,
        q=len(network.agent.lure.C),
        delay=delay,
        nc=manifest.agents[0].order,
        links=len(links),
        sources="{" + ", ".join(str(j) for _, j in links) + "}",
        listeners="{" + ", ".join(str(i) for i, _ in links) + "}",
        C=_braced(network.agent.lure.C),
        offsets=_braced(offsets) if offsets else "",
        substeps=SUBSTEPS,
        period=repr(manifest.period),
        step=repr(manifest.period / SUBSTEPS),
        NAME=manifest.name.upper(),
        c_real=manifest.real_type.c_name,
        casadi_int="long long int",
        work=max(int(advance.sz_w()), 1),
        iwork=max(int(advance.sz_iw()), 1),
    )


def _braced(matrix: Any) -> str:
    rows = (", ".join(repr(float(v)) for v in row) for row in matrix)
    return "{" + ", ".join(f"{{{row}}}" for row in rows) + "}"


def rows_of(faults: NetworkFaults, runs: int, *, noise: float = 0.0) -> Float[np.ndarray, "runs faults"]:
    """Return the same faults for a number of runs, with the standard deviation of noise on each state."""
    return np.tile(np.array(faults.row(noise)), (runs, 1))
