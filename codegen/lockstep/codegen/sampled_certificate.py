"""The certificate of the sampled controllers, of a design about to be printed or of the C in a folder.

Both sides meet here: `lockstep.lmi.sampled` proves and knows no C, this layer samples, rounds and reads.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.discretize import discretize
from lockstep.codegen.from_c import ReadController, nearest, read_controller, read_controllers
from lockstep.codegen.manifest import FILE_NAME, Manifest, load_manifest
from lockstep.codegen.verify import changed_files
from lockstep.lmi.document import Stored
from lockstep.lmi.inequality import Certificate
from lockstep.lmi.sampled import (
    HeldController,
    Network,
    SampledRho,
    SampledVerdict,
    Weights,
    certify_sampled,
    max_period,
    sampled_rho,
)
from lockstep.lmi.sampled.controller import PRECISIONS
from lockstep.lmi.sampled.inequality import Witness
from lockstep.lmi.sampled.loop import sampled_loop
from lockstep.lmi.sampled.performance import proves_rho
from lockstep.lmi.stored_bound import bound_again
from lockstep.model.assembly import network_of
from lockstep.model.errors import BoundNotProved, NotCertified, ProblemError

FOR_PERIOD = "designed_for_period"
"""Of `sampled`: that the gains were designed for the sampled loop, not for the continuous one."""


@dataclass(frozen=True)
class FolderVerdict:
    """What is proved of the C in a folder, and where that C is not what its manifest says.

    sampled: of the coefficients and the period in the C;  longest: at the largest period certified for the design's
    gains, sampled anew;  rho: the disturbance gain proved of the same C;  differences: one line for each thing
    that differs.
    """

    sampled: SampledVerdict
    longest: SampledVerdict | None
    rho: SampledRho | None
    differences: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the proof holds and the C is what the manifest says."""
        return self.sampled.certified and not self.differences


def certify_folder(folder: Path, stored: Stored, content: Mapping[str, Any]) -> FolderVerdict:
    """Prove the controllers in a folder by the numbers in their C.

    Args:
        folder: as `lockstep generate` writes it.
        stored: the design beside it, for the agents and alpha, which is proved again.
        content: the design as JSON types: its sampled witness, if there is one, is tried first.

    Raises:
        ProblemError: no folder of ours, or one for other agents.
        BoundNotProved: alpha does not bound the nonlinearity.
    """
    manifest = load_manifest(folder)
    problem_fits(stored, manifest)
    differences = [f"{path} is not what manifest.json says it is" for path in changed_files(folder, manifest)]
    names = [agent.name for agent in manifest.agents]
    differences += _misnamed(names, stored) + _strangers(folder, names)
    network = sampled_network(stored, manifest.period)
    try:
        read = read_controllers(folder, names)
        period = _period(read, manifest)
    except NotCertified as error:
        refused = SampledVerdict(False, str(error), manifest.period, network.delay)
        return FolderVerdict(refused, None, None, tuple(differences))
    differences += _differences(read, manifest, period)
    network, controllers = network.at(period), tuple(one.controller for one in read)
    guess = _guess(stored, content)
    verdict = certify_sampled(network, controllers, guess, witness=witness_in(content))
    if not verdict.certified:
        return FolderVerdict(verdict, None, None, tuple(differences))
    rho = proved_rho(stored, network, controllers, content)
    return FolderVerdict(verdict, longest_period(stored, network, guess), rho, tuple(differences))


def certify_texts(
    files: Mapping[str, str], stored: Stored, content: Mapping[str, Any]
) -> tuple[SampledVerdict, tuple[HeldController, ...]]:
    """Prove controllers that are printed and not yet written, by the numbers in their text; return these too."""
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    names = [agent.name for agent in manifest.agents]
    read = [
        read_controller(name, files[f"include/{name}.h"], files[f"src/{name}.c"], names) for name in names
    ]
    controllers = tuple(one.controller for one in read)
    network = sampled_network(stored, _period(read, manifest))
    guess = _guess(stored, content)
    return certify_sampled(network, controllers, guess, witness=witness_in(content)), controllers


def with_sampled(
    content: Mapping[str, Any],
    stored: Stored,
    verdict: SampledVerdict | None = None,
    controllers: tuple[HeldController, ...] | None = None,
) -> dict[str, Any]:
    """Return a design file's content with what is proved of its sampled controllers; as it was if it says so already.

    Nothing that the file says of them is believed: its witnesses are put to the proof again, its longest period too.

    Args:
        content: the design as JSON types;  stored: the same, parsed.
        verdict: what is known of the controllers;  controllers: these; by default they are sampled, rounded and proved
            here.
    """
    network = sampled_network(stored, stored.problem.controller.period)
    if verdict is None:
        controllers = sampled_controllers(stored, network.period)
        verdict = certify_sampled(network, controllers, _guess(stored, content), witness=witness_in(content))
    network = network.at(verdict.period)
    controllers = controllers or sampled_controllers(stored, verdict.period)
    rho = proved_rho(stored, network, controllers, content) if verdict.certified else None
    guess = _guess(stored, content)
    longest = _longest_stated(stored, network, guess, content) or longest_period(stored, network, guess)
    said = content.get("sampled")
    kept = (
        {key: value for key, value in said.items() if key == FOR_PERIOD} if isinstance(said, Mapping) else {}
    )
    return {**content, "sampled": {**sampled_document(verdict, longest, rho), **kept}}


def _longest_stated(
    stored: Stored, network: Network, guess: Any, content: Mapping[str, Any]
) -> SampledVerdict | None:
    """Return the verdict at the period that a design file states as its longest, if it is proved there."""
    said = content.get("sampled")
    period = said.get("max_period") if isinstance(said, Mapping) else None
    if not isinstance(period, int | float) or not 0 < period < 1e300 or witness_in(content) is None:
        return None
    try:
        controllers = sampled_controllers(stored, float(period))
    except ProblemError:
        return None
    verdict = certify_sampled(network.at(float(period)), controllers, guess, thorough=False)
    return verdict if verdict.certified else None


@dataclass(frozen=True)
class HeldVerdict:
    """What is proved of a design's gains as they would be sampled and rounded.

    verdict: at the period asked for;  longest: at the largest period certified;  rho: the disturbance gain, if proved.
    """

    verdict: SampledVerdict
    longest: SampledVerdict | None
    rho: SampledRho | None

    def document(self) -> dict[str, Any]:
        """Return the contract's `sampled`, without witnesses."""
        longest = None if self.longest is None else self.longest.period
        return {
            **self.verdict.document(),
            "max_period": longest,
            "rho": None if self.rho is None else self.rho.rho,
        }


def certify_sampled_design(stored: Stored, content: Mapping[str, Any]) -> HeldVerdict:
    """Prove what the C of a design file will compute, with the witnesses in it or new ones.

    Its gains are sampled and rounded as `emit` does. The counts of roundings are those of full rows; C that skips
    zeros rounds less often.
    """
    period, delay = stored.problem.controller.period, stored.problem.controller.delay
    try:
        network = sampled_network(stored, period)
    except BoundNotProved as error:
        return HeldVerdict(SampledVerdict(False, str(error), period, delay), None, None)
    return certify_held(stored, network, _guess(stored, content), content)


def certify_held(
    stored: Stored, network: Network, guess: Any, content: Mapping[str, Any] | None = None
) -> HeldVerdict:
    """Prove the sampled controllers of a design with pair weights to start from.

    Args:
        stored: the design;  network: its agents, at the period asked for.
        guess: pair weights, in the scale that goes with rho.
        content: the design as JSON types: its witnesses are tried first.
    """
    content = content or {}
    try:
        controllers = sampled_controllers(stored, network.period)
    except ProblemError as error:
        return HeldVerdict(SampledVerdict(False, str(error), network.period, network.delay), None, None)
    verdict = certify_sampled(network, controllers, guess, witness=witness_in(content))
    rho = proved_rho(stored, network, controllers, content, guess) if verdict.certified else None
    return HeldVerdict(verdict, longest_period(stored, network, guess), rho)


def longest_period(stored: Stored, network: Network, guess: Any) -> SampledVerdict | None:
    """Return the verdict at the largest period certified for a design's gains, or None."""
    return max_period(network, lambda period: sampled_controllers(stored, period), guess)


def proved_rho(
    stored: Stored,
    network: Network,
    controllers: tuple[HeldController, ...],
    content: Mapping[str, Any],
    guess: Any = None,
) -> SampledRho | None:
    """Return a proved rho of the sampled loop: that of the design file if its witness holds, else a new one."""
    problem = stored.problem
    weights = Weights(problem.state_weight(problem.agent().n), problem.controller_weight(stored.gains.order))
    known = _rho_in(content)
    if known is not None and proves_rho(sampled_loop(network, controllers), weights, known):
        return known
    return sampled_rho(network, controllers, weights, _guess(stored, content) if guess is None else guess)


def _rho_in(content: Mapping[str, Any]) -> SampledRho | None:
    sampled = content.get("sampled")
    if not isinstance(sampled, Mapping):
        return None
    rho, witness = sampled.get("rho"), Witness.from_document(sampled.get("rho_witness"))
    usable = isinstance(rho, int | float) and 0 < rho < 1e300 and witness is not None
    return SampledRho(float(rho), witness) if usable and witness is not None and rho is not None else None


def sampled_document(
    verdict: SampledVerdict, longest: SampledVerdict | None, rho: SampledRho | None
) -> dict[str, Any]:
    """Return the contract's `sampled`, with the witness: who reads it proves it again.

    Figures of the search (a spectral radius, a gain around phi) tell why a proof fails; beside one that holds they are
    left out, being computed and not proved.
    """
    witness = verdict.witness
    searched = verdict.figures if verdict.certified else {}
    return {
        **{key: value for key, value in verdict.document().items() if key not in searched},
        "max_period": None if longest is None else longest.period,
        "rho": None if rho is None else rho.rho,
        "witness": None if witness is None else witness.document(),
        "rho_witness": None if rho is None else rho.witness.document(),
    }


def witness_in(content: Mapping[str, Any]) -> Witness | None:
    """Return the sampled witness that a design file holds, if it holds one."""
    sampled = content.get("sampled")
    return Witness.from_document(sampled.get("witness")) if isinstance(sampled, Mapping) else None


def sampled_network(stored: Stored, period: float) -> Network:
    """Return the agents of a design in rationals, alpha being proved anew."""
    problem = stored.problem
    bound = bound_again(stored).or_raise()
    loop = network_of(problem, bound).loop(stored.gains.order, exact_arithmetic=True)
    return Network(loop.plant, loop.d, stored.alpha, period, problem.controller.delay)


def sampled_controllers(stored: Stored, period: float) -> tuple[HeldController, ...]:
    """Return a design's gains sampled with a period and rounded to the target type, as `emit` does."""
    problem, gains = stored.problem, stored.gains
    table, real = problem.controller, RealType(problem.controller.real)
    sources: list[list[tuple[int, float]]] = [[] for _ in range(gains.N)]
    for listener, source, weight in problem.graph().edges:
        sources[listener - 1].append((source - 1, weight))
    controllers = []
    for i, heard in enumerate(sources):
        where = f"controller {i + 1}"
        sampled = discretize(gains.A[i], gains.B[i], gains.C[i], gains.D[i], period, table.discretization)
        weights = real.round(np.array([weight for _, weight in heard], dtype=float), where)
        controllers.append(
            HeldController.row_by_row(
                real.round(sampled.stacked(), where).astype(float),
                gains.order,
                tuple(source for source, _ in heard),
                weights.astype(float),
                PRECISIONS[table.real],
            )
        )
    return tuple(controllers)


def _guess(stored: Stored, content: Mapping[str, Any]) -> Any:
    """Return pair weights to start from: those that proved rho of the sampled loop, else the continuous ones."""
    known = _rho_in(content)
    if known is not None and len(known.witness.m) == stored.gains.N * (stored.gains.N - 1) // 2:
        return known.witness.m
    return stored.certificate.m if isinstance(stored.certificate, Certificate) else None


def _period(read: list[ReadController], manifest: Manifest) -> float:
    """Return the period in the C: the manifest's double where the header's literal is its rounding."""
    literals = {one.period_literal for one in read}
    if len(literals) != 1:
        raise NotCertified(f"the headers state different periods: {', '.join(sorted(literals))}")
    (literal,) = literals
    same = nearest(literal, manifest.real) == float(manifest.real_type.dtype.type(manifest.period))
    return manifest.period if same else read[0].period


def _misnamed(names: list[str], stored: Stored) -> list[str]:
    """Say whether the agents are not in the design's order: each is proved with the inputs B of its place in it."""
    expected = [f"{stored.problem.agent().name}{i}" for i in range(1, stored.gains.N + 1)]
    if names == expected:
        return []
    return [
        f"manifest.json lists the agents as {', '.join(names)}; in the design they are {', '.join(expected)}"
    ]


def _strangers(folder: Path, names: list[str]) -> list[str]:
    """Return a line for each file that a compiler may read in place of a header that was proved.

    With -Iinclude that is any other file there: include/stdint.h, or a precompiled include/arm1.h.gch; and a header
    beside the source that includes it.
    """
    known = {f"{name}.h" for name in names}
    found = [
        path
        for path in _files(folder / "include")
        if path.relative_to(folder / "include").as_posix() not in known
    ]
    found += [path for path in _files(folder / "src") if ".h" in path.name]
    return [
        f"{path.relative_to(folder).as_posix()} was not generated, and a compiler may read it in place of what was"
        for path in found
    ]


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if not path.is_dir())


def _differences(read: list[ReadController], manifest: Manifest, period: float) -> list[str]:
    """Compare the C with its manifest, number by number."""
    found = []
    if period != manifest.period:
        found.append(f"the headers state a period of {period:g} s, manifest.json {manifest.period:g} s")
    names = [agent.name for agent in manifest.agents]
    for one, agent in zip(read, manifest.agents, strict=True):
        if one.real != manifest.real:
            found.append(f"src/{one.name}.c computes in {one.real}, manifest.json says {manifest.real}")
            continue
        table = agent.table(manifest.real_type).astype(float)
        if table.shape != one.controller.table.shape:
            found.append(f"src/{one.name}.c has gains of another size than manifest.json")
            continue
        for row, column in np.argwhere(table != one.controller.table):
            values = f"{one.controller.table[row, column]:.9g}, manifest.json {table[row, column]:.9g}"
            found.append(f"src/{one.name}.c: entry ({row + 1}, {column + 1}) of [A B; C D] is {values}")
        sources = tuple(names.index(s.source) if s.source in names else -1 for s in agent.neighbours)
        weights = agent.weights(manifest.real_type).astype(float)
        if sources != one.controller.sources or not np.array_equal(weights, one.controller.weights):
            found.append(
                f"{one.name} listens to others in its C than in manifest.json, or with other weights"
            )
    return found


def problem_fits(stored: Stored, manifest: Manifest) -> None:
    """Refuse a design that is not about the agents of a folder.

    Raises:
        ProblemError: another number of agents.
    """
    if len(manifest.agents) != stored.gains.N:
        raise ProblemError(
            f"{len(manifest.agents)} controllers",
            where="manifest.json",
            expected=f"{stored.gains.N}, as in the design",
        )
