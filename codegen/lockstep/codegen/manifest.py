"""manifest.json: what a generated folder claims to be, exactly and for machines.

Coefficients are written twice, as the shortest decimal that reads back and as a hexadecimal float; the two
must agree. `files` holds the SHA-256 of every other file, `digest` that of the manifest itself without the
key `digest`.
"""

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from lockstep.check.c_source.reader import MAX_NEIGHBOURS
from lockstep.check.errors import ProblemError, demand
from lockstep.check.files import as_text, inside, read_inside
from lockstep.check.sampled.discretise import Discretization, Real
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import Optimize
from lockstep.codegen.identifiers import check_identifier

FORMAT = "lockstep-controllers/2"
FILE_NAME = "manifest.json"

MOST_KEPT = 4096
"""Own readings that a node keeps, at the most: a slip of the pen beyond."""

_INNERMOST_LIST = re.compile(r'\[(?:\s*(?:-?[\d.eE+-]+|"[-+0-9a-fx.p]+"),?)+\s*\]')
"""A list of numbers or hexadecimal floats as `json` spreads it; a matrix row reads better on one line."""


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Coefficients(_Record):
    """A matrix of target values: shortest decimals that read back to the same bits, and exact hexadecimal."""

    decimal: tuple[tuple[float, ...], ...]
    hex: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, M: Float[np.ndarray, "rows cols"], real: RealType) -> Self:
        """Write down a matrix whose entries are already rounded to `real`."""
        return cls(
            decimal=tuple(tuple(float(real.decimal(v)) for v in row) for row in M),
            hex=tuple(tuple(float(v).hex() for v in row) for row in M),
        )

    def array(self, shape: tuple[int, int], real: RealType, where: str) -> Float[np.ndarray, "rows cols"]:
        """The matrix in the target type; raises if the shape is wrong or decimal and hexadecimal disagree."""
        try:
            exact = np.array([[float.fromhex(text) for text in row] for row in self.hex], dtype=np.float64)
            decimal = np.array(self.decimal, dtype=np.float64)
        except ValueError as error:
            raise ProblemError(f"not a matrix of numbers ({error})", where=where) from None
        if 0 in shape:
            exact, decimal = (M.reshape(shape) if M.size == 0 else M for M in (exact, decimal))
        same_shape = exact.shape == decimal.shape == shape
        demand(same_shape, f"the shape is {exact.shape}", where, str(shape))
        rounded = real.round(exact, where)
        same = (rounded == exact).all() and (real.round(decimal, where) == rounded).all()
        found = f"decimal and hexadecimal disagree, or are no exact {real.name}"
        demand(same, found, where, remedy="generate the folder again")
        return rounded


class Named(_Record):
    """A signal."""

    name: str
    unit: str


class NeighbourEntry(_Record):
    """A neighbour and its weight a_ij, rounded to the target type."""

    source: str
    weight: float


class GainsEntry(_Record):
    """[A B; C D] of the sampled controller, rounded to the target type."""

    A: Coefficients
    B: Coefficients
    C: Coefficients
    D: Coefficients


Rows = tuple[tuple[float, ...], ...]


class PlantEntry(_Record):
    """The agent's linear part and start: closed-loop test data are made from it."""

    A: Rows
    B: Rows
    C: Rows
    x0: tuple[float, ...]


class AgentEntry(_Record):
    """One controller of the folder."""

    name: str
    order: int = Field(ge=0)
    outputs: tuple[Named, ...] = Field(min_length=1)
    inputs: tuple[Named, ...] = Field(min_length=1)
    neighbours: tuple[NeighbourEntry, ...] = Field(max_length=MAX_NEIGHBOURS)
    continuous: dict[Literal["A", "B", "C", "D"], Rows]
    sampled: GainsEntry
    state_bytes: int
    stack_budget_bytes: dict[str, int]
    flash_budget_bytes: dict[str, int]
    instruction_budget: dict[str, int] = {}
    integer_instruction_budget: dict[str, int] | None = None
    plant: PlantEntry | None = None
    limits: Rows | None = None
    offsets: Rows | None = None

    @model_serializer(mode="wrap")
    def _without_limits(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave `limits` out where u is not clipped, `offsets` where there are none, and integers where there are none."""
        plain: dict[str, Any] = serialize(self)
        left_out = ("limits", "offsets", "integer_instruction_budget")
        return {key: value for key, value in plain.items() if key not in left_out or value is not None}

    def shifts(self, real: RealType) -> Float[np.ndarray, "nn+1 q"] | None:
        """What is taken from own outputs, and from each neighbour's, in the target type; None where nothing is.

        Raises:
            ProblemError: not one row for each, or no numbers of the type.
        """
        rows, columns = 1 + len(self.neighbours), len(self.outputs)
        return self._matrix("offsets", (rows, columns), f"{rows} x {columns} numbers", real)

    def sides(self, real: RealType) -> Float[np.ndarray, "m 2"] | None:
        """Where u is clipped, in the target type; None where it is not.

        Raises:
            ProblemError: not one pair for each input, or no numbers of the type.
        """
        return self._matrix("limits", (len(self.inputs), 2), f"{len(self.inputs)} pairs", real)

    def _matrix(
        self, name: str, shape: tuple[int, int], said: str, real: RealType
    ) -> Float[np.ndarray, "rows cols"] | None:
        given, where = getattr(self, name), f"{FILE_NAME}, agent `{self.name}`, {name}"
        if given is None:
            return None
        rows = np.array(given, dtype=np.float64)
        rounded, expected = real.round(rows, where), f"{said} of {real.name}"
        demand(rows.shape == shape and (rounded == rows).all(), f"{rows.tolist()}", where, expected)
        return rounded

    def table(self, real: RealType) -> Float[np.ndarray, "nc+m nc+q"]:
        """[A B; C D] in the target type."""
        n, q, m = self.order, len(self.outputs), len(self.inputs)
        where = f"{FILE_NAME}, agent `{self.name}`"
        A, B, C, D = (
            getattr(self.sampled, letter).array(shape, real, f"{where}, {letter}")
            for letter, shape in {"A": (n, n), "B": (n, q), "C": (m, n), "D": (m, q)}.items()
        )
        return np.block([[A, B], [C, D]])

    def weights(self, real: RealType) -> Float[np.ndarray, " nn"]:
        """The weights a_ij in the target type."""
        given = np.array([source.weight for source in self.neighbours], dtype=np.float64)
        return real.round(given, f"{FILE_NAME}, agent `{self.name}`, weights")


class Arithmetic(_Record):
    """How sums are formed: fixed by this format, so that a reader need not guess."""

    order: str
    zero_terms: Literal["skipped", "kept"]
    contraction: Literal["off"]


class Identification(_Record):
    """SHA-256 of the design and of what is claimed of it: the macros and the descriptors of the C say the same."""

    design: str = Field(pattern="^[0-9a-f]{64}$")
    claims: str = Field(pattern="^[0-9a-f]{64}$")


class ImageEntry(_Record):
    """One image for all nodes: `agents` are then its controllers, by the node's number."""

    name: str
    agents: int = Field(ge=1, description="N of the design; 1 where it is for any number of agents")
    largest_in_degree: int = Field(ge=0, description="of its graph: so many roundings of r are covered")
    max_neighbours: int = Field(ge=1, le=MAX_NEIGHBOURS, description="of a list, at compile time")
    state_bytes: int
    table: Literal["none", "csv", "c"]


class MessagesEntry(_Record):
    """What the message layer is told: `messages/`, if it is generated, has these numbers.

    kept: own readings that a node keeps, a power of 2;  limit: periods after which what is held counts as stale;
    ranges: lowest and highest of an output by name, None where there is none.
    """

    kept: int = Field(ge=2, le=MOST_KEPT)
    limit: int = Field(ge=1, le=2**31 - 1)
    ranges: dict[str, tuple[float | None, float | None]]


class FixedEntry(_Record):
    """Formats of the controllers in integers: exponents e, a count being worth 2^-e; states by agent; and what is claimed."""

    outputs: tuple[int, ...]
    inputs: tuple[int, ...]
    states: tuple[tuple[int, ...], ...]
    claims: tuple[str, ...]


class Manifest(_Record):
    """The whole of manifest.json."""

    format: Literal["lockstep-controllers/2"]
    name: str
    title: str
    design_hash: str
    period: float = Field(gt=0, allow_inf_nan=False)
    discretization: Discretization
    real: Real
    optimize: Optimize
    arithmetic: Arithmetic
    certificate: dict[str, str | float | bool | None]
    agents: tuple[AgentEntry, ...] = Field(min_length=1)
    files: dict[str, str]
    identity: Identification
    prefix: str = ""
    image: ImageEntry | None = None
    messages: MessagesEntry | None = None
    fixed: FixedEntry | None = None
    digest: str = ""

    @model_validator(mode="after")
    def _safe(self) -> Self:
        for path in self.files:
            try:
                inside(path, FILE_NAME)
            except ProblemError as error:
                raise ValueError(error.found) from None
        return self

    @property
    def real_type(self) -> RealType:
        """The arithmetic of the C code."""
        return RealType(self.real)

    def sealed(self) -> "Manifest":
        """The same manifest with its digest."""
        content = {key: value for key, value in self._plain().items() if key != "digest"}
        return self.model_copy(update={"digest": digest_of(content)})

    def text(self) -> str:
        """The JSON text of the file."""
        spread = json.dumps(self._plain(), indent=1, ensure_ascii=False, allow_nan=False)
        return _INNERMOST_LIST.sub(lambda found: " ".join(found.group().split()), spread) + "\n"

    def _plain(self) -> dict[str, Any]:
        # Absent rather than null: a folder without them is as it was before there were any.
        exclude = {name for name in ("image", "messages", "fixed") if getattr(self, name) is None}
        return self.model_dump(mode="json", exclude_none=False, exclude=exclude)


def sha256(content: str | bytes) -> str:
    """Hexadecimal SHA-256 of a file's bytes, or of its text in UTF-8."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def digest_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON object, whatever the order of its keys."""
    return sha256(json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":")))


def load_manifest(directory: Path | str) -> Manifest:
    """Read and check manifest.json; raises `ProblemError` if it is missing, malformed or inconsistent.

    A wrong digest is no error here: `verify_folder` reports it as a changed file.
    """
    folder, path = Path(directory), Path(directory) / FILE_NAME
    expected = "a folder that `lockstep generate` wrote"
    demand(os.path.lexists(path), f"there is no {FILE_NAME}", str(directory), expected)
    text = as_text(read_inside(folder, FILE_NAME, expected=expected), str(path), expected)
    try:
        manifest = Manifest.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        found = f"{first['msg']} at `{place}`" if place else first["msg"]
        raise ProblemError(found, where=str(path), remedy="generate the folder again") from None
    for name in (manifest.name, *units(manifest)[len(manifest.agents) :]):
        check_identifier(name, str(path))
    for agent in manifest.agents:
        check_identifier(agent.name, str(path))
        agent.table(manifest.real_type)
        agent.sides(manifest.real_type)
        agent.shifts(manifest.real_type)
    return manifest


def units(manifest: Manifest) -> list[str]:
    """Return the names of the pairs of header and source: the agents', and that of the nodes of one image."""
    return [
        *(agent.name for agent in manifest.agents),
        *([] if manifest.image is None else [manifest.image.name]),
    ]


def manifest_is_intact(manifest: Manifest) -> bool:
    """Whether the manifest is what was written with its digest."""
    return manifest.digest == manifest.sealed().digest


def changed_files(folder: Path, manifest: Manifest) -> tuple[str, ...]:
    """Files that differ from their hash, are missing, or are compiled but not listed; the manifest too."""
    changed = [path for path, digest in manifest.files.items() if _sha256(folder, path) != digest]
    needed = [
        f"{place}/{unit}.{end}" for unit in units(manifest) for place, end in (("include", "h"), ("src", "c"))
    ]
    changed += [path for path in needed if path not in manifest.files]
    if not manifest_is_intact(manifest):
        changed.append(FILE_NAME)
    return tuple(changed)


def _sha256(folder: Path, path: str) -> str:
    try:
        return sha256(read_inside(folder, path))
    except ProblemError:
        return ""
