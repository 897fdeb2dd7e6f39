"""Coefficients of the bounds that the header states, as `benchmarks/bounds_fit.py` prints them.

Tenths, by the parts of `budget` and `bounds`; above measurements with head room: 15 % and 16 bytes of stack, 30 % and 64 of
flash, 30 % of instructions, half as much again of those in integers.
ROUTINES are the most instructions of soft arithmetic that `benchmarks/soft_arithmetic.py` finds.
"""

from lockstep.check.sampled.discretise import Real
from lockstep.codegen.spec import Optimize

Table = dict[tuple[str, Real, Optimize], tuple[int, ...]]

# sums, v - v, sums of 0 and NaN, products, comparisons: the most that was found, in compiler-rt and libgcc
ROUTINES: dict[tuple[str, Real], tuple[int, ...]] = {
    ("cortex-m0", "float32"): (180, 137, 55, 172, 43),
    ("cortex-m0", "float64"): (418, 279, 110, 517, 71),
    ("cortex-m4f", "float64"): (179, 115, 55, 680, 57),
    ("cortex-m7", "float64"): (179, 115, 55, 680, 57),
    ("rv32imac", "float32"): (180, 130, 38, 139, 31),
    ("rv32imac", "float64"): (267, 177, 45, 223, 44),
    ("rv32imafc", "float64"): (267, 177, 45, 223, 44),
}
STACK: Table = {
    ("cortex-m0", "float32", "size"): (2789, 73, 8, 0, 657, 36, 10, 672, 4),
    ("cortex-m0", "float32", "speed"): (2167, 121, 0, 3, 846, 37, 1, 391, 0),
    ("cortex-m0", "float64", "size"): (2104, 185, 288, 0, 1370, 10, 106, 912, 0),
    ("cortex-m0", "float64", "speed"): (2528, 229, 0, 7, 913, 75, 5, 350, 0),
    ("cortex-m4f", "float32", "size"): (925, 90, 170, 0, 477, 1, 56, 425, 0),
    ("cortex-m4f", "float32", "speed"): (991, 44, 140, 10, 434, 0, 23, 687, 0),
    ("cortex-m4f", "float64", "size"): (2324, 127, 498, 0, 1503, 0, 114, 785, 0),
    ("cortex-m4f", "float64", "speed"): (2298, 322, 195, 0, 562, 110, 0, 223, 0),
    ("rv32imac", "float32", "size"): (1638, 69, 286, 0, 1003, 0, 26, 492, 0),
    ("rv32imac", "float32", "speed"): (1742, 133, 0, 4, 0, 46, 10, 184, 0),
    ("rv32imac", "float64", "size"): (1482, 216, 327, 0, 961, 0, 90, 881, 0),
    ("rv32imac", "float64", "speed"): (1888, 251, 0, 7, 414, 74, 0, 128, 0),
    ("rv32imafc", "float32", "size"): (782, 102, 169, 0, 340, 0, 37, 505, 0),
    ("rv32imafc", "float32", "speed"): (760, 94, 10, 46, 0, 16, 30, 556, 0),
}
FLASH: Table = {
    ("cortex-m0", "float32", "size"): (10742, 283, 0, 14, 14476, 454, 17, 7895, 3099, 0, 0, 736, 1128, 0),
    ("cortex-m0", "float32", "speed"): (0, 0, 0, 340, 19549, 424, 822, 4876, 0, 5729, 0, 309, 1416, 0),
    ("cortex-m0", "float64", "size"): (6652, 1489, 0, 0, 7484, 226, 258, 9810, 4740, 0, 620, 0, 2904, 8),
    ("cortex-m0", "float64", "speed"): (5683, 1814, 0, 465, 4533, 548, 207, 16651, 0, 0, 520, 13385, 0, 0),
    ("cortex-m4f", "float32", "size"): (0, 969, 0, 0, 14568, 158, 925, 1252, 1420, 9688, 0, 0, 1536, 161),
    ("cortex-m4f", "float32", "speed"): (9728, 256, 0, 246, 4730, 479, 573, 10120, 6987, 0, 0, 0, 2070, 22),
    ("cortex-m4f", "float64", "size"): (8803, 1491, 0, 5, 21357, 356, 667, 1405, 0, 0, 0, 0, 1513, 293),
    ("cortex-m4f", "float64", "speed"): (
        7088,
        2055,
        0,
        509,
        3097,
        1532,
        210,
        24113,
        10485,
        0,
        0,
        5950,
        1266,
        95,
    ),
    ("rv32imac", "float32", "size"): (0, 1307, 5119, 0, 16967, 0, 0, 0, 0, 2151, 0, 17289, 1217, 186),
    ("rv32imac", "float32", "speed"): (0, 1140, 0, 509, 10910, 1194, 0, 0, 0, 6449, 0, 13453, 1803, 0),
    ("rv32imac", "float64", "size"): (3455, 2811, 4059, 0, 13682, 396, 0, 0, 0, 0, 0, 895, 4536, 0),
    ("rv32imac", "float64", "speed"): (5120, 3835, 0, 618, 2029, 1882, 0, 0, 12161, 0, 0, 5411, 3188, 0),
    ("rv32imafc", "float32", "size"): (0, 1066, 744, 0, 18583, 298, 0, 0, 0, 8666, 0, 7915, 891, 178),
    ("rv32imafc", "float32", "speed"): (9110, 906, 0, 395, 7150, 570, 0, 0, 868, 0, 0, 6231, 1101, 22),
}
OWN: Table = {
    ("cortex-m0", "float32", "size"): (0, 176, 38, 521, 476, 968, 669, 275, 470),
    ("cortex-m0", "float32", "speed"): (0, 90, 210, 485, 323, 0, 418, 189, 990),
    ("cortex-m0", "float64", "size"): (0, 246, 654, 960, 51, 550, 771, 218, 718),
    ("cortex-m0", "float64", "speed"): (0, 153, 339, 748, 229, 0, 724, 267, 968),
    ("cortex-m4f", "float32", "size"): (0, 112, 391, 312, 336, 0, 182, 138, 135),
    ("cortex-m4f", "float32", "speed"): (89, 50, 0, 328, 250, 122, 262, 120, 451),
    ("cortex-m4f", "float64", "size"): (0, 205, 314, 539, 357, 498, 767, 162, 262),
    ("cortex-m4f", "float64", "speed"): (0, 153, 347, 664, 61, 0, 370, 165, 442),
    ("rv32imac", "float32", "size"): (0, 151, 698, 496, 217, 437, 0, 217, 326),
    ("rv32imac", "float32", "speed"): (0, 138, 145, 477, 350, 211, 236, 157, 230),
    ("rv32imac", "float64", "size"): (0, 215, 879, 702, 300, 579, 70, 270, 217),
    ("rv32imac", "float64", "speed"): (0, 211, 370, 714, 186, 161, 366, 190, 353),
    ("rv32imafc", "float32", "size"): (0, 88, 471, 297, 139, 300, 0, 201, 287),
    ("rv32imafc", "float32", "speed"): (148, 99, 0, 244, 427, 27, 224, 102, 223),
}
INTEGERS: dict[str, tuple[int, ...]] = {
    "cortex-m0": (130, 81, 0, 1392, 0, 0, 188, 0),
    "cortex-m4f": (167, 59, 0, 935, 0, 0, 0, 0),
    "rv32imac": (174, 82, 0, 862, 0, 0, 244, 0),
}
