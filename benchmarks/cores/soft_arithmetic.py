"""The most instructions of each routine of soft arithmetic, in compiler-rt (zig) and libgcc, by search over operands.

    python benchmarks/cores/soft_arithmetic.py [--count N] [--seed S]    N random operands, and many chosen ones

A row says the most of any operands and of which, of v - v (`itself`), and of sums of zeros and NaN (`nothing`).
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from bounds import Machine, targets

from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.cores import CORES
from lockstep.verification.harness import compile_objects
from lockstep.verification.machines.image import link_image, machine_flags


def operands(random, real, count):
    """Pairs of bit patterns: subnormal, near and far exponents, cancelling, products about both ends, and random ones."""
    p, width = (23, 32) if real == "float32" else (52, 64)
    largest, sign, full = (1 << (width - 1 - p)) - 1, 1 << (width - 1), (1 << p) - 1
    some = [
        0,
        1,
        2,
        3,
        full,
        full + 1,
        full + 2,
        1 << (p - 1),
        2 * full + 1,
        2 * full + 2,
        largest << p,
        (largest << p) - 1,
    ]
    some += [(largest << p) + 1, 3 << (width - 4), (largest >> 1) << p]
    some += [v | sign for v in some]
    yield from ((a, b) for a in some for b in some)
    yield from ((1 << i, 1 << j | side) for i in range(p + 1) for j in range(p + 1) for side in (0, sign))

    def digits():
        bit = 1 << int(random.integers(0, p))
        return int(
            random.choice([0, full, bit, full ^ bit, bit - 1, full & -bit, random.integers(0, full + 1)])
        )

    for _ in range(count):
        ends = [
            0,
            largest,
            random.integers(1, 5),
            largest - random.integers(1, 5),
            random.integers(0, largest + 1),
        ]
        e, f = int(random.choice(ends)), digits()
        way = random.integers(0, 5)
        near = [random.choice(ends), e + random.integers(-p - 4, p + 5), e, e + random.integers(-2, 3)]
        near.append(largest // 2 * random.choice([1, 3]) - e + random.integers(-p - 3, 4))
        g = (
            digits()
            if way in (0, 1, 4)
            else f ^ (1 << int(random.integers(0, p)))
            if way == 2
            else (f + int(random.integers(-4, 5))) & full
        )
        other = min(max(int(near[way]), 0), largest)
        signs = random.integers(0, 2, 2)
        yield int(signs[0]) * sign | e << p | f, int(signs[1]) * sign | other << p | g


def routines(seed, pairs):
    """The most instructions of each routine: any operands, v - v, and sums of zeros and NaN."""
    for group, core in CORES.items():
        for real, f, s in (("float32", "f", "s"), ("float64", "d", "d")):
            for compiler in dict.fromkeys(c for c, _ in targets(core)) if real not in core.hardware else ():
                with tempfile.TemporaryDirectory(prefix="lockstep-bounds-") as temporary:
                    place, c_real = Path(temporary), RealType(real).c_name
                    one = "{0} zz_{1}({2} a, {2} b);\n{0} zz_{1}({2} a, {2} b) {{ return a {3} b; }}\n"
                    used = [(c_real, n, c_real, n) for n in "+-*"] + [
                        ("int", n, c_real, n) for n in ("==", "!=", "<", ">")
                    ]
                    named = [(t, f"f{k}", c, n) for k, (t, _, c, n) in enumerate(used)]
                    (place / "zz.c").write_text("".join(one.format(*each) for each in named))
                    objects = compile_objects(
                        compiler, (*machine_flags(core, compiler), "-O2"), [place / "zz.c"], place, place
                    )
                    machine = Machine(link_image(objects, "zz_f0", core, compiler, place, bare=False), core)
                names = [f"__aeabi_{f}{n}" for n in ("add", "sub", "mul", "cmpeq", "cmplt", "cmpgt")]
                if not machine.arm:
                    names = [f"__{n}{s}f3" for n in ("add", "sub", "mul")] + [
                        f"__{n}{s}f2" for n in ("eq", "ne", "lt", "gt", "le", "ge")
                    ]

                def count(name, a, b, machine=machine, wide=real == "float64"):
                    machine.begin()
                    low = 0xFFFF_FFFF
                    machine.call(name, *((a & low, a >> 32, b & low, b >> 32) if wide else (a, b)))
                    return machine.own + machine.library

                given = list(operands(np.random.default_rng(seed), real, pairs))
                nothing = [
                    (0, 1 << 31, 0x7FC0_0000, 0xFFC1_2345),
                    (0, 1 << 63, 0x7FF8 << 48, (0xFFF8 << 48) | 9),
                ][real == "float64"]
                for name in (n for n in names if n in machine.symbols):
                    row = {"core": group, "real": real, "compiler": compiler.name, "routine": name}
                    row["most"], row["of"] = max(
                        (count(name, *pair), [hex(v) for v in pair]) for pair in given
                    )
                    if "sub" in name:
                        row["itself"] = max(count(name, a, a) for a, _ in given)
                    if "add" in name or "sub" in name:
                        row["nothing"] = max(count(name, a, b) for a in nothing for b in nothing)
                    yield row


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2500)
    parser.add_argument("--seed", type=int, default=11)
    given = parser.parse_args()
    for found in routines(given.seed, given.count):
        print(json.dumps(found), flush=True)
