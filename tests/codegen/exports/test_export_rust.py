"""`generate --rust`: the crate builds with cargo and without the net, and its steps are equal to the bit."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import arms, random_controller
from export_cases import folder_of, generated, needs, run
from typer.testing import CliRunner

from lockstep.cli.main import app
from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.exports.vectors import vectors
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.reference import Reference
from lockstep.verification.stimulus import run_reference

pytestmark = needs("cargo", "rustc", "cc", "ar")

MAIN = """
use std::io::BufRead;
use {crate_}::{agent}::*;

fn main() {{
    let mut controller = Controller::new().expect("a fit build");
    for line in std::io::stdin().lock().lines() {{
        let words: Vec<u64> = line.unwrap().split(' ').map(|word| u64::from_str_radix(word, 16).unwrap()).collect();
        let real: Vec<{real}> = words[2..].iter().map(|bits| {real}::from_bits(*bits as _)).collect();
        let mut neighbour_y = [[0.0; OUTPUTS]; NEIGHBOURS];
        for j in 0..NEIGHBOURS {{
            neighbour_y[j].copy_from_slice(&real[(1 + j) * OUTPUTS..(2 + j) * OUTPUTS]);
        }}
        let mut u = [0.0; INPUTS];
        let status = match words[0] {{
            1 => controller.step_relative(real[(1 + NEIGHBOURS) * OUTPUTS..].try_into().unwrap(), &mut u),
            2 => {{ controller.reset(); {crate_}::Status::OK }}
            {applied}
            4 => {{ controller = Controller::new().unwrap(); {crate_}::Status(3) }} // no state here is uninitialised
            _ => controller.step(real[..OUTPUTS].try_into().unwrap(), &neighbour_y, words[1] as Mask, &mut u),
        }};
        print!("{{}}", status.0);
        for value in u {{
            print!(" {{:x}}", value.to_bits());
        }}
        println!();
    }}
}}
"""

APPLIED_ARM = "5 => controller.applied(real[(1 + NEIGHBOURS) * OUTPUTS..][..INPUTS].try_into().unwrap()),"
"""Of agents whose inputs are clipped: the relative output is given back as what was applied."""


def compared(folder, tmp_path, index=0):
    """A program of its own that uses the crate, fed with the test vectors; the number of calls that differ."""
    manifest = load_manifest(folder)
    agent = manifest.agents[index]
    program, width = tmp_path / "program", manifest.real_type.bytes
    (program / "src").mkdir(parents=True)
    (program / "Cargo.toml").write_text(
        f'[package]\nname = "program"\nversion = "0.0.0"\nedition = "2021"\n'
        f'[dependencies]\n{manifest.name} = {{ path = "{folder / "rust"}" }}\n'
    )
    (program / "src" / "main.rs").write_text(
        MAIN.format(
            crate_=manifest.name,
            agent=agent.name,
            real=f"f{8 * width}",
            applied=APPLIED_ARM if agent.limits is not None else "",
        )
    )
    calls = vectors(agent, manifest)
    values = np.concatenate([calls.y, calls.neighbour_y.reshape(len(calls.y), -1), calls.r], axis=1)
    words = np.ascontiguousarray(values).view(f"u{width}").tolist()
    lines = [
        " ".join(f"{word:x}" for word in (operation, mask, *row))
        for operation, mask, row in zip(calls.operation.tolist(), calls.received.tolist(), words, strict=True)
    ]
    run(["cargo", "build", "--offline", "--quiet"], program)
    printed = run([program / "target" / "debug" / "program"], program, input="\n".join(lines).encode())
    expected = run_reference(Reference.of(agent, manifest), calls)
    bits = np.ascontiguousarray(expected.u).view(f"u{width}").tolist()
    wrong = 0
    for k, line in enumerate(printed.decode().splitlines()):
        status, *u = line.split()
        same_u = (
            calls.operation[k] in (Operation.RESET, Operation.APPLIED)
            or [int(word, 16) for word in u] == bits[k]
        )
        wrong += not (same_u and int(status) == expected.status[k])
    assert len(printed.splitlines()) == len(lines) == 200
    assert (calls.operation == Operation.STEP_RELATIVE).any()
    return wrong


def test_the_crate_steps_as_the_reference(root, tmp_path):
    folder = generated(root, tmp_path / "arms", "--rust")
    assert "#![no_std]" in (folder / "rust" / "src" / "lib.rs").read_text()
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0
    assert compared(folder, tmp_path, index=2) == 0
    # What is built goes to the user's own folder: nothing is left in ours.
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0


@pytest.mark.parametrize("neighbours", [0, 33])
def test_float64_leaders_and_wide_masks(tmp_path, neighbours):
    agents = (random_controller("agent", 3, 2, 3, neighbours=neighbours),)
    assert (
        compared(folder_of(tmp_path, arms(agents=agents, plants=(), real="float64"), "rust"), tmp_path) == 0
    )


def test_other_outputs_are_seen(tmp_path, monkeypatch):
    """The crate against a reference that was fed with other measurements."""
    folder, original = folder_of(tmp_path, arms(), "rust"), run_reference
    monkeypatch.setitem(
        globals(), "run_reference", lambda one, calls: original(one, replace(calls, y=calls.y + 1))
    )
    assert compared(folder, tmp_path) > 50


def test_a_changed_gain_makes_no_controller(tmp_path):
    folder = folder_of(tmp_path, arms(), "rust")
    source = folder / "src" / "arm1.c"
    source.write_text(source.read_text().replace("-0.739f", "-0.749f", 1))
    with pytest.raises(AssertionError, match=r"a fit build: Status\(4\)"):
        compared(folder, tmp_path)


def test_an_unfit_build_makes_no_controller(tmp_path):
    """Another known answer stands for other arithmetic: both differ from what is computed here."""
    folder = folder_of(tmp_path, arms(), "rust")
    source = folder / "src" / "arm1.c"
    source.write_text(re.sub(r"(answer\[9\] = \{)[^,]*", r"\g<1>1.0f", source.read_text()))
    with pytest.raises(AssertionError, match=r"a fit build: Status\(4\)"):
        compared(folder, tmp_path)


def test_a_changed_build_script_is_refused(root, tmp_path):
    folder = generated(root, tmp_path / "arms", "--rust")
    script = folder / "rust" / "build.rs"
    script.write_text(script.read_text().replace("-ffp-contract=off", "-ffp-contract=fast"))
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 1
    shutil.rmtree(folder / "rust")
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 1
