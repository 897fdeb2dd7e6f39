"""Coefficients of the bounds that the header states, as `benchmarks/cores/bounds_fit.py` prints them.

Tenths, by the parts of `budget` and `bounds`; above measurements with head room: 15 % and 16 bytes of stack, 30 % and 64 of
flash, 30 % of instructions, half as much again of those in integers.
ROUTINES are the most instructions of soft arithmetic that `benchmarks/cores/soft_arithmetic.py` finds.
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
    ("cortex-m0", "float32", "size"): (0, 583, 879, 0, 22327, 206, 383, 5748, 3878, 8798, 0, 2448, 806, 0),
    ("cortex-m0", "float32", "speed"): (4635, 1151, 0, 283, 8221, 728, 208, 17866, 125, 0, 0, 4534, 824, 233),
    ("cortex-m0", "float64", "size"): (6601, 1540, 0, 0, 7305, 0, 885, 2547, 5712, 0, 571, 0, 2661, 78),
    ("cortex-m0", "float64", "speed"): (5388, 2137, 0, 437, 3643, 871, 832, 9707, 0, 0, 222, 8329, 327, 0),
    ("cortex-m4f", "float32", "size"): (10174, 454, 0, 30, 3485, 422, 565, 6283, 2299, 0, 0, 0, 2195, 116),
    ("cortex-m4f", "float32", "speed"): (9966, 10, 0, 254, 6731, 518, 458, 9647, 6458, 0, 0, 0, 2076, 74),
    ("cortex-m4f", "float64", "size"): (9099, 1173, 0, 28, 18206, 626, 342, 7592, 0, 0, 0, 6321, 1410, 295),
    ("cortex-m4f", "float64", "speed"): (0, 1202, 0, 552, 17689, 1284, 347, 17204, 9584, 7897, 0, 477, 2141, 93),
    ("rv32imac", "float32", "size"): (12668, 989, 74, 0, 22325, 493, 0, 0, 3798, 0, 0, 3511, 1327, 0),
    ("rv32imac", "float32", "speed"): (0, 2351, 0, 430, 15082, 1212, 0, 0, 0, 5316, 0, 7222, 917, 0),
    ("rv32imac", "float64", "size"): (3861, 2758, 3707, 0, 11722, 641, 0, 0, 429, 0, 0, 0, 4786, 137),
    ("rv32imac", "float64", "speed"): (0, 4217, 144, 601, 20547, 1351, 0, 0, 5454, 4612, 0, 0, 2139, 0),
    ("rv32imafc", "float32", "size"): (9992, 1010, 0, 0, 12646, 218, 302, 0, 5690, 0, 0, 6139, 617, 0),
    ("rv32imafc", "float32", "speed"): (8996, 1048, 0, 367, 12185, 536, 0, 0, 5142, 0, 0, 2037, 917, 0),
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
