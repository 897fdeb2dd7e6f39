"""Coefficients of the bounds that the header states, as `benchmarks/cores/bounds_fit.py` prints them.

Tenths, by the parts of `budget` and `bounds`; above measurements with head room: 15 % and 16 bytes of stack, 30 % and 64 of
flash, 30 % of instructions, half as much again of those in integers.
ROUTINES are the most instructions of soft arithmetic that `benchmarks/cores/soft_arithmetic.py` finds.
"""

from typing import Literal

from lockstep.check.sampled.discretise import Real

Optimize = Literal["speed", "size"]
"""What the C is made for: products unrolled, or loops over a table."""

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
    ("cortex-m0", "float32", "size"): (2811, 74, 0, 0, 615, 39, 10, 641, 198),
    ("cortex-m0", "float32", "speed"): (2164, 124, 0, 3, 797, 36, 8, 318, 0),
    ("cortex-m0", "float64", "size"): (2210, 185, 262, 0, 1326, 20, 90, 912, 0),
    ("cortex-m0", "float64", "speed"): (2501, 225, 0, 7, 941, 78, 0, 361, 0),
    ("cortex-m4f", "float32", "size"): (925, 90, 170, 0, 477, 1, 56, 425, 0),
    ("cortex-m4f", "float32", "speed"): (981, 45, 150, 10, 436, 0, 21, 712, 0),
    ("cortex-m4f", "float64", "size"): (2196, 127, 529, 0, 1859, 30, 32, 785, 0),
    ("cortex-m4f", "float64", "speed"): (2247, 323, 242, 0, 584, 105, 0, 222, 0),
    ("rv32imac", "float32", "size"): (1639, 69, 286, 0, 1002, 0, 26, 492, 0),
    ("rv32imac", "float32", "speed"): (1487, 111, 43, 6, 221, 32, 29, 374, 0),
    ("rv32imac", "float64", "size"): (1368, 173, 483, 0, 2105, 5, 6, 923, 0),
    ("rv32imac", "float64", "speed"): (1427, 227, 214, 10, 679, 52, 22, 0, 0),
    ("rv32imafc", "float32", "size"): (761, 103, 171, 0, 355, 0, 37, 504, 0),
    ("rv32imafc", "float32", "speed"): (760, 94, 10, 46, 0, 16, 30, 556, 0),
}
# fmt: off
FLASH: Table = {
    ("cortex-m0", "float32", "size"): (0, 583, 879, 18, 22327, 255, 383, 6560, 3878, 8798, 0, 2448, 1250, 51),
    ("cortex-m0", "float32", "speed"): (4635, 1151, 0, 283, 8221, 728, 501, 17866, 125, 1691, 0, 4534, 824, 233),
    ("cortex-m0", "float64", "size"): (6601, 1540, 2732, 0, 7527, 0, 885, 11290, 5712, 0, 571, 0, 2661, 78),
    ("cortex-m0", "float64", "speed"): (5388, 2137, 1296, 449, 3643, 871, 832, 12633, 0, 0, 222, 8329, 499, 94),
    ("cortex-m4f", "float32", "size"): (10174, 454, 699, 30, 9495, 503, 565, 6283, 2299, 0, 0, 0, 2195, 116),
    ("cortex-m4f", "float32", "speed"): (9966, 163, 272, 254, 11508, 518, 458, 9647, 6458, 0, 0, 0, 2076, 74),
    ("cortex-m4f", "float64", "size"): (9099, 1173, 725, 28, 18206, 839, 342, 7592, 0, 4424, 0, 6321, 1410, 295),
    ("cortex-m4f", "float64", "speed"): (1106, 1323, 0, 552, 17689, 1284, 546, 17204, 9584, 13325, 0, 477, 2141, 93),
    ("rv32imac", "float32", "size"): (12668, 989, 74, 7, 22325, 493, 0, 0, 3798, 2850, 0, 4866, 1683, 0),
    ("rv32imac", "float32", "speed"): (0, 2351, 0, 430, 15082, 1212, 0, 0, 0, 6239, 0, 7222, 917, 0),
    ("rv32imac", "float64", "size"): (3861, 2758, 3707, 0, 19846, 707, 0, 0, 429, 0, 0, 0, 4786, 175),
    ("rv32imac", "float64", "speed"): (0, 4217, 144, 601, 20547, 1351, 0, 0, 5454, 9463, 0, 0, 2139, 0),
    ("rv32imafc", "float32", "size"): (11530, 1144, 86, 0, 12646, 218, 302, 0, 5690, 11, 0, 6139, 823, 7),
    ("rv32imafc", "float32", "speed"): (8996, 1123, 0, 367, 12185, 536, 0, 0, 5142, 0, 0, 2037, 1791, 0),
}
# fmt: on
OWN: Table = {
    ("cortex-m0", "float32", "size"): (0, 145, 791, 686, 145, 27, 355, 126, 641),
    ("cortex-m0", "float32", "speed"): (0, 90, 210, 485, 323, 0, 418, 189, 1008),
    ("cortex-m0", "float64", "size"): (0, 246, 647, 951, 68, 558, 773, 218, 726),
    ("cortex-m0", "float64", "speed"): (0, 153, 338, 746, 229, 0, 723, 266, 974),
    ("cortex-m4f", "float32", "size"): (0, 114, 392, 288, 357, 0, 261, 111, 181),
    ("cortex-m4f", "float32", "speed"): (89, 50, 0, 328, 250, 122, 262, 122, 446),
    ("cortex-m4f", "float64", "size"): (0, 199, 488, 570, 342, 250, 699, 98, 250),
    ("cortex-m4f", "float64", "speed"): (0, 153, 349, 666, 56, 0, 369, 168, 433),
    ("rv32imac", "float32", "size"): (0, 147, 776, 479, 346, 299, 121, 142, 216),
    ("rv32imac", "float32", "speed"): (0, 138, 140, 477, 358, 213, 239, 155, 222),
    ("rv32imac", "float64", "size"): (0, 222, 828, 694, 305, 620, 139, 243, 219),
    ("rv32imac", "float64", "speed"): (0, 209, 425, 720, 200, 75, 346, 180, 333),
    ("rv32imafc", "float32", "size"): (0, 87, 569, 287, 302, 87, 57, 96, 137),
    ("rv32imafc", "float32", "speed"): (105, 97, 73, 313, 206, 0, 194, 104, 375),
}
INTEGERS: dict[str, tuple[int, ...]] = {
    "cortex-m0": (130, 81, 0, 1392, 0, 0, 188, 0),
    "cortex-m4f": (167, 59, 0, 935, 0, 0, 0, 0),
    "rv32imac": (174, 82, 0, 862, 0, 0, 244, 0),
}
