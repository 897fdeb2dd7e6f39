"""The bare-metal example: built with zig, from reset to sleep, then one timer interrupt per period."""

import struct

import numpy as np
import pytest

from lockstep.codegen.cost.cores import CORES, emulated, registers_of
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.machines.emulator import missing_packages
from lockstep.verification.machines.image import load_image, machine_flags, undefined_symbols
from lockstep.verification.reference import references
from lockstep.verification.toolchain import run, zig

pytestmark = pytest.mark.skipif(
    zig() is None or bool(missing_packages()), reason="ziglang, unicorn or pyelftools is not installed"
)
CORE = CORES["cortex-m4f"]
BOARD, SYSTICK, CPACR, RETURN = 0x4000_0000, 0xE000_E010, 0xE000_ED88, 0x0800_0000
HANGS = 600_000_000
"""Microseconds after which the emulator is held to hang, on any machine."""


@pytest.fixture(scope="module")
def firmware(root, tmp_path_factory):
    directory = tmp_path_factory.mktemp("firmware")
    example, folder = root / "examples" / "bare_metal", root / "generated" / "flexible_joint_arms"
    sources = [example / "main.c", example / "startup.c", folder / "src" / "arm1.c"]
    flags = [
        *machine_flags(CORE, zig()),
        "-std=c99",
        "-Os",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-Werror",
    ]
    places = [f"-I{folder / 'include'}", f"-I{example}"]
    link = ["-nostdlib", "-Wl,--build-id=none", "-T", str(example / "board.ld"), "-o", "firmware.elf"]
    run([*zig().command, *flags, *places, *map(str, sources), *link], directory, "building", 180)
    return directory / "firmware.elf"


class Board:
    """The emulated core with the board's registers as plain memory."""

    def __init__(self, path):
        self.image, self.names, self.core = load_image(path), registers_of(CORE), emulated(CORE)
        for address, size in ((0, 0x4_0000), (0x2000_0000, 0x8000), (BOARD, 0x1000), (0xE000_E000, 0x1000)):
            self.core.mem_map(address, size)
        self.core.mem_map(RETURN, 0x1000)
        for address, data, _ in self.image.segments:
            self.core.mem_write(address, data)
        self.core.mem_write(0x2000_0000, b"\xa5" * 0x8000)  # what RAM holds at power-on is not zero
        self.stack, *self.vectors = struct.unpack("<16I", self.core.mem_read(0, 64))

    def word(self, address):
        return struct.unpack("<I", self.core.mem_read(address, 4))[0]

    def reset(self):
        """Run from the reset vector to the `wfi` of the main loop."""
        self.core.reg_write(self.names.sp, self.stack)
        main = self.image.symbols["main"] & ~1
        asleep = next(a for a in range(main, main + 400, 2) if self.core.mem_read(a, 2) == b"\x30\xbf")
        self.core.emu_start(self.vectors[0], asleep, timeout=HANGS)
        assert self.core.reg_read(self.names.pc) & ~1 == asleep

    def tick(self, y, radio, received):
        """One timer interrupt, with a new message (its sequence number raised by two) or an old one; returns the command."""
        self.core.mem_write(BOARD, struct.pack("<2f", *y))
        self.core.mem_write(BOARD + 16, struct.pack("<2fI", *radio, self.word(BOARD + 24) + 2 * received))
        return self.interrupt()

    def was_fed(self):
        """Whether the watchdog was fed since it was last asked."""
        fed = self.word(BOARD + 28)
        self.core.mem_write(BOARD + 28, bytes(4))
        return fed == 0xB0A7

    def interrupt(self):
        self.core.reg_write(self.names.link, RETURN | 1)
        self.core.emu_start(self.vectors[14], RETURN, timeout=HANGS)
        assert self.core.reg_read(self.names.pc) & ~1 == RETURN
        return np.frombuffer(self.core.mem_read(BOARD + 8, 4), np.float32)[0]


def test_the_timer_interrupt_steps_the_controller_bit_for_bit(firmware, root):
    board = Board(firmware)
    board.reset()
    manifest = load_manifest(root / "generated" / "flexible_joint_arms")
    assert board.word(CPACR) & 0xF << 20 == 0xF << 20, "the floating-point unit is on"
    assert board.word(SYSTICK) == 7
    assert board.word(SYSTICK + 4) + 1 == round(48e6 * manifest.period)
    reference, random = references(manifest)["arm1"], np.random.default_rng(0)
    for _ in range(300):
        y, radio = random.normal(size=(2, 2)).astype(np.float32)
        received = int(random.random() < 0.9)
        status, u = reference.step(y, radio[None], received)
        assert status in (0, 8), "u meets its limit of 10 V now and then"
        assert board.tick(y, radio, received).tobytes() == u[0].tobytes()
    assert board.word(BOARD + 12) == 0
    assert reference.state.misses[0] > 10


def test_one_fault_holds_the_command_and_is_counted(firmware):
    board = Board(firmware)
    board.reset()
    held = board.tick([0.5, 0], [0, 0], 1)
    assert held != 0 and board.was_fed()
    assert board.tick([np.nan, 0], [0, 0], 1) == held
    assert (board.word(BOARD + 12), board.was_fed()) == (1, False)
    assert board.tick([0.4, 0], [0, 0], 1) not in (0, held), "and it recovers"
    assert board.was_fed()


def test_an_interrupt_that_flushes_to_zero_lets_the_motor_go(firmware):
    """`main` computes as it should and init says OK; the interrupt's FPSCR has bit 24, FZ, as FPDSCR would give it."""
    from unicorn.arm_const import UC_ARM_REG_FPSCR

    board = Board(firmware)
    board.reset()
    board.core.reg_write(UC_ARM_REG_FPSCR, 1 << 24)
    assert [board.tick([0.5, 0], [0, 0], 1) for _ in range(5)] == [0] * 5
    assert not board.was_fed()


def test_faults_in_a_row_stop_the_motor_until_the_board_is_reset(firmware):
    board = Board(firmware)
    board.reset()
    held = board.tick([0.5, 0], [0, 0], 1)
    assert [board.tick([np.nan, 0], [0, 0], 1) for _ in range(3)] == [held, held, 0]
    board.was_fed()
    assert [board.tick([0.5, 0], [0, 0], 1) for _ in range(50)] == [0] * 50
    assert (board.word(BOARD + 12), board.was_fed()) == (3, False)
    board.reset()
    assert board.tick([0.5, 0], [0, 0], 1) == held


def test_a_message_that_is_not_finite_is_one_that_is_missing(firmware):
    """One dead sensor of the neighbour's does not stop this board."""
    board = Board(firmware)
    board.reset()
    board.tick([0.5, 0], [0.1, 0], 1)
    assert board.tick([0.5, 0], [np.nan, 0], 1) != 0
    assert (board.word(BOARD + 12), board.was_fed()) == (0, True)


def test_old_messages_stop_the_motor_until_the_board_is_reset(firmware):
    board = Board(firmware)
    board.reset()
    for received in (1, *(0,) * 22):
        assert board.tick([0.5, 0], [0.1, 0], received) != 0
    assert [board.tick([0.5, 0], [0.1, 0], received) for received in (0, 1, 1)] == [0, 0, 0]


def test_a_handler_that_takes_longer_than_a_period_stops_the_motor(firmware):
    board = Board(firmware)
    board.reset()
    assert board.tick([0.5, 0], [0.1, 0], 1) != 0
    board.was_fed()
    board.core.mem_write(SYSTICK, struct.pack("<I", 7 | 1 << 16))
    board.tick([0.5, 0], [0.1, 0], 1)
    board.core.mem_write(SYSTICK, struct.pack("<I", 7))
    assert (board.tick([0.5, 0], [0.1, 0], 1), board.was_fed()) == (0, False)


def test_a_trap_lets_the_motor_go(firmware):
    board = Board(firmware)
    board.reset()
    assert board.tick([0.5, 0], [0.1, 0], 1) != 0
    board.core.emu_start(board.vectors[2], RETURN, count=50)
    assert board.word(BOARD + 8) == 0


def test_a_message_that_is_half_written_is_not_taken(firmware, root):
    """The radio writes while the handler reads: at the start (odd), or between the two halves."""
    board, reference = (
        Board(firmware),
        references(load_manifest(root / "generated" / "flexible_joint_arms"))["arm1"],
    )
    board.reset()
    y, old, new = (np.array(v, np.float32) for v in ((0.5, 0.1), (0.2, 0.3), (-0.4, 0.9)))
    assert board.tick(y, old, 1).tobytes() == reference.step(y, old[None], 1)[1].tobytes()
    board.core.mem_write(BOARD + 16, struct.pack("<2fI", new[0], old[1], 3))
    assert board.interrupt().tobytes() == reference.step(y, old[None], 0)[1].tobytes()
    board.core.mem_write(BOARD + 16, struct.pack("<2fI", *old, 2))

    from unicorn import UC_HOOK_MEM_READ

    def write_in_between(core, _access, address, *_):
        if address == BOARD + 20:
            core.mem_write(BOARD + 20, struct.pack("<fI", new[1], 6))

    board.core.mem_write(BOARD + 16, struct.pack("<2fI", *old, 4))
    hook = board.core.hook_add(UC_HOOK_MEM_READ, write_in_between)
    assert board.interrupt().tobytes() == reference.step(y, old[None], 0)[1].tobytes()
    board.core.hook_del(hook)
    board.core.mem_write(BOARD + 16, struct.pack("<2fI", *new, 6))
    assert board.interrupt().tobytes() == reference.step(y, new[None], 1)[1].tobytes()


def test_the_firmware_holds_no_library(firmware):
    ours = (
        "arm1",
        "receive",
        "start",
        "taken",
        "faults",
        "checked",
        "Reset_",
        "Stop_",
        "SysTick_",
        "main",
        "vectors",
        "controller",
        "startup.c",
        "$",
    )
    linker = {"_stack_top", "_data_load", "_data_start", "_data_end", "_bss_start", "_bss_end"}
    names = set(load_image(firmware).symbols) - linker
    assert [name for name in names if not name.startswith(ours)] == []
    assert list(undefined_symbols(firmware)) == []
