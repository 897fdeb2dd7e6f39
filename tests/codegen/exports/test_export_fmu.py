"""`generate --fmu`: FMPy finds no error in the units, and their runs are those of our simulation."""

import json
import shutil
import zipfile

import numpy as np
import pytest
from codegen_cases import arms, random_controller
from export_cases import folder_of, generated, needs_compiler
from scipy.integrate import solve_ivp
from test_folder_attacks import reseal
from typer.testing import CliRunner

import lockstep
from lockstep.cli.main import app
from lockstep.codegen.bundle import bundle
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import Neighbour, Signal
from lockstep.verification import fmu as compiled
from lockstep.verification.fmu import units
from lockstep.verification.reference import Reference

pytestmark = needs_compiler
PERIOD = 0.005


@pytest.fixture(scope="module")
def fmpy():
    return pytest.importorskip("fmpy")


@pytest.fixture(scope="module")
def folder(root, tmp_path_factory):
    return generated(root, tmp_path_factory.mktemp("fmu") / "arms", "--fmu")


@pytest.fixture(scope="module")
def run(folder):
    """Our simulation: the nonlinear arms, the sampled controllers, 4 s."""
    return lockstep.simulate(folder, horizon=4.0, integrator="adaptive").trajectory


class Unit:
    """One unit, used as a co-simulation master does."""

    def __init__(self, archive, directory, *, token=None, log=None):
        from fmpy import extract, read_model_description
        from fmpy.fmi3 import FMU3Slave

        self.described = read_model_description(str(archive), validate=True)
        self.reference = {v.name: v.valueReference for v in self.described.modelVariables}
        self.fmu = FMU3Slave(
            guid=token or self.described.instantiationToken,
            unzipDirectory=extract(str(archive), str(directory / archive.stem)),
            modelIdentifier=self.described.coSimulation.modelIdentifier,
            instanceName=archive.stem,
        )
        self.fmu.instantiate(logMessage=log)
        self.start()

    def start(self, time=0.0):
        self.fmu.enterInitializationMode(startTime=time)
        self.fmu.exitInitializationMode()

    def step(self, t, size, **inputs):
        for name, value in inputs.items():
            self.set(name, value)
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=size)

    def set(self, prefix, values):
        names = [name for name in self.reference if name.startswith(f"{prefix}[")]
        real = self.fmu.setFloat32 if self.single else self.fmu.setFloat64
        real([self.reference[name] for name in names], [float(v) for v in np.ravel(values)])

    @property
    def single(self):
        return self.described.modelVariables[1].type == "Float32"

    def get(self, name):
        real = self.fmu.getFloat32 if self.single else self.fmu.getFloat64
        return real([self.reference[name]])[0]

    @property
    def status(self):
        return self.fmu.getInt32([self.reference["status"]])[0]


def test_fmpy_finds_no_error(folder, fmpy):
    from fmpy.validation import validate_fmu

    for i in (1, 2, 3):
        archive = str(folder / "fmu" / f"arm{i}.fmu")
        assert validate_fmu(archive) == []
        assert set(fmpy.supported_platforms(archive)) == {"c-code", fmpy.platform}


@pytest.mark.parametrize("i", [0, 1, 2])
def test_a_unit_alone_gives_the_inputs_of_our_simulation(folder, fmpy, run, i):
    """Fed with the outputs of all agents, at every sample; what it gives at t_k+1 is u on [t_k, t_k+1)."""
    columns = {"time": run.t, "y[0]": run.y[:, i, 0], "y[1]": run.y[:, i, 1]}
    columns |= {f"neighbour_y[0,{k}]": run.y[:, (i + 1) % 3, k] for k in (0, 1)}
    table = np.rec.fromarrays(list(columns.values()), names=list(columns))
    result = fmpy.simulate_fmu(
        str(folder / "fmu" / f"arm{i + 1}.fmu"),
        stop_time=4.0,
        output_interval=PERIOD,
        input=table,
        output=["u[0]", "status"],
    )
    assert len(result) == len(run.t) == 801
    assert not result["status"].any()
    assert np.abs(result["u[0]"][1:] - run.u[:-1, i, 0]).max() <= 1e-6
    assert np.abs(run.u).max() > 1


def arm(x, u):
    """(38), by hand."""
    a, b, c, d = x
    return [b, -48.6 * a - 1.25 * b + 48.6 * c + 21.6 * u, d, 19.5 * a - 19.5 * c - 3.33 * np.sin(c)]


@pytest.mark.usefixtures("fmpy")
def test_the_loop_closed_around_the_units_is_our_simulation(folder, run, tmp_path):
    """The arms by another integrator; states within 1e-6 over 4 s."""
    held = [Unit(folder / "fmu" / f"arm{i}.fmu", tmp_path) for i in (1, 2, 3)]
    x = [np.array(row) for row in ([0.8, 0, 0.8, 0], [-0.5, 0, -0.5, 0], [0.2, 0, 0.2, 0])]
    worst = 0.0
    for k, t in enumerate(run.t[:-1]):
        worst = max(worst, np.abs(np.array(x) - run.x[k]).max())
        y = [state[:2] for state in x]
        for i, unit in enumerate(held):
            unit.step(t, PERIOD, y=y[i], neighbour_y=y[(i + 1) % 3])
        u = [unit.get("u[0]") for unit in held]
        x = [
            solve_ivp(
                lambda _, s, v=v: arm(s, v), (0, PERIOD), state, rtol=1e-11, atol=1e-13, method="DOP853"
            ).y[:, -1]
            for state, v in zip(x, u, strict=True)
        ]
    assert worst <= 1e-6
    assert np.abs(run.x[0] - run.x[-1]).max() > 0.1


@pytest.mark.usefixtures("fmpy")
def test_steps_shorter_longer_and_shifted(folder, tmp_path):
    """A controller step at each start + k T, whatever the size of the communication steps."""
    manifest = load_manifest(folder)
    unit, reference = Unit(folder / "fmu" / "arm1.fmu", tmp_path), Reference.of(manifest.agents[0], manifest)
    unit.fmu.reset()
    unit.start(0.3)
    y, other = np.float32([0.5, -0.25]), np.float32([[0.125, 0.75]])
    t, done = 0.3, 0
    for size, steps in (
        (PERIOD / 4, 1),
        (PERIOD / 2, 0),
        (PERIOD / 4, 0),
        (PERIOD, 1),
        (3 * PERIOD, 3),
        (PERIOD * 1.5, 2),
    ):
        unit.step(t, size, y=y, neighbour_y=other)
        t += size
        for _ in range(steps):
            _, u = reference.step(y, other, 1)
        done += steps
        assert unit.get("u[0]") == float(u[0])
    assert done == 7


@pytest.mark.usefixtures("fmpy")
def test_a_fault_and_a_lost_message_are_those_of_the_step(folder, tmp_path):
    manifest = load_manifest(folder)
    unit, reference = Unit(folder / "fmu" / "arm2.fmu", tmp_path), Reference.of(manifest.agents[1], manifest)
    y, other = np.float32([0.5, -0.25]), np.float32([[0.125, 0.75]])
    for k, (own, received) in enumerate([(y, 1), (y * 2, 0), (np.float32([np.nan, 0]), 1), (y, 1)]):
        unit.fmu.setUInt32([unit.reference["received"]], [received])
        unit.step(k * PERIOD, PERIOD, y=own, neighbour_y=other * (k + 1))
        status, u = reference.step(own, other * (k + 1), received)
        assert (unit.status, unit.get("u[0]")) == (status, float(u[0]))
    assert reference.state.misses == [1]


def test_a_unit_refuses_what_it_does_not_have(folder, fmpy, tmp_path):
    unit = Unit(folder / "fmu" / "arm1.fmu", tmp_path)
    for wrong in (
        lambda: unit.fmu.getFloat64([1]),
        lambda: unit.fmu.getFloat32([99]),
        lambda: unit.fmu.setFloat32([unit.reference["u[0]"]], [1.0]),
        lambda: unit.fmu.getInt8([1]),
        unit.fmu.getFMUState,
    ):
        with pytest.raises(fmpy.fmi1.FMICallException):
            wrong()


def refused(archive, tmp_path, **options):
    """What a unit tells its master, of which it makes no instance."""
    told = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        Unit(
            archive,
            tmp_path,
            log=lambda _, status, category, text: told.append((status, category, text)),
            **options,
        )
    ((status, category, text),) = told
    assert (status, category) == (3, b"logStatusError")
    return text.decode()


@pytest.mark.usefixtures("fmpy")
def test_a_build_that_computes_otherwise_makes_no_instance(tmp_path):
    """Another known answer stands for other arithmetic: both differ from what is computed here."""
    texts = with_exports(emit(arms()), ["fmu"])
    source = texts["src/arm1.c"]
    first = source[source.index("answer[9] = {") + 13 :].partition(",")[0]
    texts["src/arm1.c"] = source.replace(first, "1.0f")
    archive = tmp_path / "arm1.fmu"
    archive.write_bytes(units(texts)["fmu/arm1.fmu"])
    said = refused(archive, tmp_path)
    assert "arm1_init found that this build computes otherwise" in said and "-ffp-contract=off" in said


@pytest.mark.usefixtures("fmpy")
def test_the_token_of_another_unit_makes_no_instance(folder, tmp_path):
    assert "modelDescription.xml" in refused(folder / "fmu" / "arm1.fmu", tmp_path, token="arm1-0")


def test_the_sources_alone_build(fmpy, tmp_path, monkeypatch):
    """As without a compiler; then FMPy builds them with CMake, in its own way."""
    if shutil.which("cmake") is None:
        pytest.skip("not installed: cmake")
    from fmpy.build import build_platform_binary
    from fmpy.validation import validate_fmu

    monkeypatch.setattr(compiled, "host_compilers", list)
    texts = with_exports(emit(arms()), ["fmu"])
    archive = tmp_path / "arm1.fmu"
    archive.write_bytes(units(texts)["fmu/arm1.fmu"])
    assert validate_fmu(str(archive)) == []
    assert fmpy.supported_platforms(str(archive)) == ["c-code"]
    unzipped = tmp_path / "unzipped"
    fmpy.extract(str(archive), str(unzipped))
    (tmp_path / "build").mkdir()
    build_platform_binary(unzipped, tmp_path / "build")
    assert any(unzipped.glob("binaries/*/arm1.*"))


@pytest.mark.usefixtures("fmpy")
def test_other_arithmetic_many_neighbours_and_strange_names(tmp_path):
    """float64, a mask of 64 bits, a leader; units and names that XML does not take as they are."""
    strange = {"outputs": (Signal('a<b&"c"\x00', "m<s"),), "inputs": (Signal("u]]>", "N·m"),)}
    one = {"A": [[-1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.5]]}
    from lockstep.codegen.spec import Controller

    agents = (
        Controller("leader", **one, **strange),
        Controller("many", **one, neighbours=tuple(Neighbour(f"p{j}") for j in range(40)), **strange),
        random_controller("plain", 2, 3, 2),
    )
    texts = with_exports(emit(arms(agents=agents, plants=(), real="float64", title="a & b < c")), ["fmu"])
    folder = write_folder(bundle(texts, units(texts)), tmp_path / "c")
    from fmpy.validation import validate_fmu

    manifest = load_manifest(folder)
    for agent in manifest.agents:
        assert validate_fmu(str(folder / "fmu" / f"{agent.name}.fmu")) == []
    unit, reference = Unit(folder / "fmu" / "plain.fmu", tmp_path), Reference.of(manifest.agents[2], manifest)
    random = np.random.default_rng(1)
    for k in range(20):
        y, other = random.normal(size=3), random.normal(size=(2, 3))
        unit.step(k * 0.005, 0.005, y=y, neighbour_y=other)
        assert [unit.get("u[0]"), unit.get("u[1]")] == reference.step(y, other, 3)[1].tolist()


def certify(folder):
    result = CliRunner().invoke(app, ["certify", str(folder), "--json"])
    return result.exit_code, json.loads(result.stdout)


def test_certify_names_the_binaries_as_not_proved(folder):
    code, answer = certify(folder)
    assert (code, answer["differences"]) == (0, [])
    assert answer["not_proved"] == [f"fmu/arm{i}.fmu" for i in (1, 2, 3)]


def repacked(change):
    def apply(folder):
        archive = folder / "fmu" / "arm1.fmu"
        with zipfile.ZipFile(archive) as old:
            members = {name: old.read(name) for name in old.namelist()}
        change(members)
        with zipfile.ZipFile(archive, "w") as new:
            for name, content in members.items():
                new.writestr(zipfile.ZipInfo(name), content)

    return apply


ATTACKS = {
    "a source in the archive": repacked(lambda m: m.update({"sources/arm1.c": m["sources/arm1.c"] + b"\n"})),
    "a file added to the archive": repacked(lambda m: m.update({"resources/x.sh": b"x"})),
    "a member missing": repacked(lambda m: m.pop("sources/fmi3.c")),
    "bytes before the archive": lambda folder: (folder / "fmu/arm1.fmu").write_bytes(
        b"#!/bin/sh\n" + (folder / "fmu/arm1.fmu").read_bytes()
    ),
    "no archive": lambda folder: (folder / "fmu/arm1.fmu").write_bytes(b"PK"),
    "the text beside it": lambda folder: (folder / "fmu/arm1/sources/fmi3.c").write_text("int x;\n"),
    "the description beside it": lambda folder: (folder / "fmu/arm1/modelDescription.xml").unlink(),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_is_changed_in_a_unit_is_refused(folder, tmp_path, attack):
    changed = shutil.copytree(folder, tmp_path / "c")
    ATTACKS[attack](changed)
    reseal(changed)
    code, answer = certify(changed)
    assert code == 1
    assert any("fmu/arm1" in said for said in answer["differences"])


def test_the_archive_is_the_same_each_time(tmp_path):
    texts = with_exports(emit(arms()), ["fmu"])
    assert units(texts) == units(texts)
    assert folder_of(tmp_path, arms(), "fmu").is_dir()
