"""The emulated microcontrollers: how to compile for each, and which registers Unicorn calls what.

The Cortex-M7 is the one with a single-precision unit: Unicorn does not decode the double-precision one's
instructions. Soft-float cores take the arithmetic from the compiler's library (compiler-rt, libgcc), which rounds as
IEEE 754 asks, subnormals included: bitwise equality is the contract there too.
"""

import importlib
from dataclasses import dataclass
from typing import Any, Literal

from lockstep.check.sampled.discretise import Real

Architecture = Literal["arm", "riscv"]


@dataclass(frozen=True)
class Core:
    """A microcontroller core.

    group         its name as a target of `verify`
    title         its name for people
    architecture  "arm" (Thumb code) or "riscv" (32 bits)
    cpu           Unicorn's constant
    machine       flags for zig's clang
    gcc           flags for arm-none-eabi-gcc; empty: that compiler is not for this core
    hardware      the arithmetics that the core does without a library
    """

    group: str
    title: str
    architecture: Architecture
    cpu: str
    machine: tuple[str, ...]
    gcc: tuple[str, ...]
    hardware: tuple[Real, ...]


def _arm(cpu: str, abi: str) -> tuple[str, ...]:
    return ("-target", f"thumb-freestanding-{abi}", f"-mcpu={cpu}")


def _riscv(extensions: str) -> tuple[str, ...]:
    return ("-target", "riscv32-freestanding-none", f"-mcpu=generic_rv32{extensions}")


CORES = {
    core.group: core
    for core in (
        Core(
            "cortex-m0",
            "Cortex-M0",
            "arm",
            "UC_CPU_ARM_CORTEX_M0",
            _arm("cortex_m0", "eabi"),
            ("-mthumb", "-mcpu=cortex-m0", "-mfloat-abi=soft"),
            (),
        ),
        Core(
            "cortex-m4f",
            "Cortex-M4F",
            "arm",
            "UC_CPU_ARM_CORTEX_M4",
            _arm("cortex_m4+vfp4d16sp", "eabihf"),
            ("-mthumb", "-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
            ("float32",),
        ),
        Core(
            "cortex-m7",
            "Cortex-M7",
            "arm",
            "UC_CPU_ARM_CORTEX_M7",
            _arm("cortex_m7+fp_armv8d16sp", "eabihf"),
            ("-mthumb", "-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"),
            ("float32",),
        ),
        Core("rv32imac", "RV32IMAC", "riscv", "UC_CPU_RISCV32_ANY", _riscv("+m+a+c"), (), ()),
        Core("rv32imafc", "RV32IMAFC", "riscv", "UC_CPU_RISCV32_ANY", _riscv("+m+a+f+c"), (), ("float32",)),
    )
}
"""Every core that is emulated, by its group's name."""


@dataclass(frozen=True)
class Registers:
    """What a call needs: Unicorn's numbers, and the address bit that says Thumb."""

    sp: int
    link: int
    pc: int
    argument: int
    thumb: int


def registers_of(core: Core) -> Registers:
    """The registers of a core; needs Unicorn."""
    if core.architecture == "arm":
        arm = importlib.import_module("unicorn.arm_const")
        return Registers(arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC, arm.UC_ARM_REG_R0, thumb=1)
    riscv = importlib.import_module("unicorn.riscv_const")
    return Registers(
        riscv.UC_RISCV_REG_SP, riscv.UC_RISCV_REG_RA, riscv.UC_RISCV_REG_PC, riscv.UC_RISCV_REG_A0, thumb=0
    )


def emulated(core: Core) -> Any:
    """A fresh Unicorn core of this kind, its floating-point unit switched on as start-up code does."""
    unicorn = importlib.import_module("unicorn")
    if core.architecture == "arm":
        arm = importlib.import_module("unicorn.arm_const")
        mode = unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        machine = unicorn.Uc(unicorn.UC_ARCH_ARM, mode, getattr(arm, core.cpu))
        if core.hardware:
            machine.reg_write(arm.UC_ARM_REG_FPEXC, 1 << 30)
        return machine
    riscv = importlib.import_module("unicorn.riscv_const")
    machine = unicorn.Uc(unicorn.UC_ARCH_RISCV, unicorn.UC_MODE_RISCV32, getattr(riscv, core.cpu))
    if core.hardware:
        machine.reg_write(riscv.UC_RISCV_REG_MSTATUS, 3 << 13)  # FS: dirty
    return machine
