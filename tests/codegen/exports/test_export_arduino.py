"""`generate --arduino`: avr-gcc builds the library as Arduino does, and its steps under simavr are equal to the bit."""

import re

import pytest
from codegen_cases import arms
from export_cases import folder_of, generated, needs, run
from typer.testing import CliRunner

from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.verification.verify import verify_log

pytestmark = needs("avr-gcc", "avr-g++", "simavr")

CHIP = ("-mmcu=atmega1284p", "-DF_CPU=16000000UL")
C_FLAGS = (
    "-Os",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-std=gnu11",
    "-ffunction-sections",
    "-fdata-sections",
    "-flto",
)
CPP_FLAGS = ("-Os", "-Wall", "-Wextra", "-std=gnu++11", "-fno-exceptions", "-flto")
"""Those of Arduino's own core for AVR."""

# What a sketch does: one header, and the loop of the test vectors over the serial line.
SKETCH = """
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <lockstep_{library}.h>
#include "pil.h"

static {agent}_state_t unused;

void pil_putc(char c) {{ while (!(UCSR0A & _BV(UDRE0))) {{}} UDR0 = c; }}
int pil_getc(void) {{ return -1; }}

int main() {{
    {agent}_init(&unused);
    UCSR0B = _BV(TXEN0);
    {agent}_pil();
    while (!(UCSR0A & _BV(UDRE0))) {{}}
    cli();
    sleep_mode();
}}
"""


def log_of(folder, tmp_path, library, agents):
    """The log over the serial line of a chip per agent."""
    parts = []
    for agent in agents:
        source = folder / "arduino" / "src" / f"{agent}.c"
        places = [f"-I{folder / 'arduino' / 'src'}", f"-I{folder / 'pil'}"]
        c = [source, folder / "pil" / f"{agent}_pil.c", folder / "pil" / "pil.c"]
        objects = [tmp_path / f"{path.stem}.o" for path in c]
        for path, made in zip(c, objects, strict=True):
            run(["avr-gcc", *CHIP, *C_FLAGS, *places, "-c", path, "-o", made], tmp_path)
        sketch, program = tmp_path / "sketch.cpp", tmp_path / f"{agent}.elf"
        sketch.write_text(SKETCH.format(library=library, agent=agent))
        run(["avr-g++", *CHIP, *CPP_FLAGS, *places, sketch, *objects, "-o", program], tmp_path)
        printed = run(["simavr", "-m", "atmega1284p", "-f", "16000000", program], tmp_path, errors_too=True)
        # simavr colours each line and shows its end as a dot.
        parts.append(
            re.sub(r"\.$", "", re.sub(r"\x1b\[\d+m", "", printed.decode("latin-1")), flags=re.MULTILINE)
        )
    log = tmp_path / "log.txt"
    log.write_text("\n".join(parts))
    return log


@pytest.mark.slow
def test_the_steps_on_avr_are_equal_to_the_bit(root, tmp_path):
    folder = generated(root, tmp_path / "arms", "--pil", "--arduino")
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0
    report = verify_log(folder, log_of(folder, tmp_path, "arm_controllers", ["arm1", "arm2", "arm3"]))
    assert report.problems == ()
    assert report.targets[0].bitwise


def test_a_loop_over_a_table_too(tmp_path):
    spec = arms(optimize="size")
    folder = folder_of(tmp_path, spec, "pil", "arduino")
    log = log_of(folder, tmp_path, "arms", [agent.name for agent in spec.agents])
    assert verify_log(folder, log).problems == ()


def test_a_changed_gain_is_seen(tmp_path):
    folder = folder_of(tmp_path, arms(), "pil", "arduino")
    source = folder / "arduino" / "src" / "arm2.c"
    text = source.read_text()
    gain = re.search(r"\d\.\d{6,}f", text)[0]
    source.write_text(text.replace(gain, f"{float(gain[:-1]) * 1.001!r}f", 1))
    report = verify_log(folder, log_of(folder, tmp_path, "arms", ["arm1", "arm2", "arm3"]))
    assert [agent.bitwise for agent in report.targets[0].agents] == [True, False, True]


def test_a_copy_that_differs_is_refused(root, tmp_path):
    from test_folder_attacks import reseal

    folder = generated(root, tmp_path / "arms", "--arduino")
    copy = folder / "arduino" / "src" / "arm1.c"
    text = copy.read_text()
    copy.write_text(re.sub(r"= -?[0-9.]+f \* x1;", "= 0.123f * x1;", text, count=1))
    assert copy.read_text() != text
    reseal(folder)
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 1


def test_a_double_that_avr_does_not_have_is_refused(tmp_path):
    with pytest.raises(ProblemError, match=r"float64.*32 bits on AVR"):
        folder_of(tmp_path, arms(real="float64"), "arduino")
