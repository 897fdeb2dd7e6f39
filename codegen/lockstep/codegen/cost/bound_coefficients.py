"""Coefficients of the bounds that the header states, as `benchmarks/cores/bounds_fit.py` prints them (`fit`, then `raise`).

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
    ("cortex-m0", "float32", "size"): (2861, 73, 13, 0, 314, 62, 52, 545, 0),
    ("cortex-m0", "float32", "speed"): (2476, 56, 126, 7, 183, 39, 95, 229, 0),
    ("cortex-m0", "float64", "size"): (3272, 174, 72, 0, 152, 201, 0, 697, 0),
    ("cortex-m0", "float64", "speed"): (3370, 119, 71, 12, 0, 206, 3, 586, 63),
    ("cortex-m4f", "float32", "size"): (1456, 89, 62, 0, 117, 58, 18, 767, 0),
    ("cortex-m4f", "float32", "speed"): (1260, 50, 0, 10, 199, 49, 14, 831, 0),
    ("cortex-m4f", "float64", "size"): (3024, 154, 554, 0, 0, 114, 26, 1437, 0),
    ("cortex-m4f", "float64", "speed"): (2402, 288, 408, 2, 96, 130, 30, 1188, 0),
    ("rv32imac", "float32", "size"): (2317, 90, 119, 0, 0, 60, 20, 817, 0),
    ("rv32imac", "float32", "speed"): (2036, 59, 116, 8, 0, 42, 56, 457, 322),
    ("rv32imac", "float64", "size"): (2852, 150, 334, 0, 0, 105, 31, 1122, 0),
    ("rv32imac", "float64", "speed"): (2402, 140, 291, 12, 38, 90, 43, 830, 136),
    ("rv32imafc", "float32", "size"): (1385, 86, 68, 0, 93, 45, 28, 474, 0),
    ("rv32imafc", "float32", "speed"): (771, 87, 108, 46, 0, 37, 37, 576, 0),
}
# fmt: off
FLASH: Table = {
    ("cortex-m0", "float32", "size"): (0, 819, 0, 0, 16904, 529, 463, 7027, 7238, 10105, 0, 0, 1473, 0),
    ("cortex-m0", "float32", "speed"): (0, 1002, 0, 282, 14058, 543, 505, 6626, 5362, 7220, 0, 1242, 1346, 0),
    ("cortex-m0", "float64", "size"): (0, 1586, 0, 0, 10681, 1140, 889, 16113, 5451, 12528, 172, 5630, 1586, 104),
    ("cortex-m0", "float64", "speed"): (0, 2372, 0, 424, 9931, 556, 140, 9387, 13998, 8048, 592, 3197, 1126, 0),
    ("cortex-m4f", "float32", "size"): (0, 874, 0, 0, 15940, 484, 816, 4825, 1309, 13591, 0, 0, 976, 132),
    ("cortex-m4f", "float32", "speed"): (0, 1061, 0, 196, 11984, 537, 660, 6352, 0, 8872, 0, 400, 1174, 209),
    ("cortex-m4f", "float64", "size"): (15510, 1460, 216, 0, 3467, 1132, 687, 7296, 2593, 62, 0, 0, 1878, 234),
    ("cortex-m4f", "float64", "speed"): (0, 2098, 1680, 505, 10098, 1134, 521, 7051, 8294, 6824, 93, 2284, 1473, 17),
    ("rv32imac", "float32", "size"): (0, 1043, 711, 0, 31093, 617, 0, 0, 13854, 18101, 0, 1005, 1710, 0),
    ("rv32imac", "float32", "speed"): (0, 2757, 94, 378, 8893, 1285, 0, 0, 5170, 7757, 0, 6749, 2042, 0),
    ("rv32imac", "float64", "size"): (0, 1912, 890, 0, 19202, 2039, 0, 0, 6307, 15940, 0, 0, 3972, 0),
    ("rv32imac", "float64", "speed"): (0, 1920, 0, 697, 17614, 2036, 0, 0, 5253, 13807, 0, 766, 3777, 0),
    ("rv32imafc", "float32", "size"): (0, 854, 0, 0, 27902, 546, 0, 0, 9816, 14656, 0, 0, 1349, 0),
    ("rv32imafc", "float32", "speed"): (0, 2267, 0, 312, 11725, 696, 0, 0, 5666, 6359, 0, 6415, 554, 0),
}
# fmt: on
OWN: Table = {
    ("cortex-m0", "float32", "size"): (0, 153, 587, 540, 358, 565, 296, 242, 1152),
    ("cortex-m0", "float32", "speed"): (0, 101, 61, 500, 575, 451, 279, 264, 1116),
    ("cortex-m0", "float64", "size"): (0, 263, 444, 812, 515, 1222, 512, 235, 1438),
    ("cortex-m0", "float64", "speed"): (0, 169, 58, 748, 623, 978, 443, 332, 1319),
    ("cortex-m4f", "float32", "size"): (0, 118, 308, 378, 297, 350, 221, 110, 570),
    ("cortex-m4f", "float32", "speed"): (157, 49, 17, 369, 363, 138, 225, 145, 538),
    ("cortex-m4f", "float64", "size"): (0, 188, 649, 728, 266, 429, 372, 155, 427),
    ("cortex-m4f", "float64", "speed"): (0, 161, 161, 714, 316, 586, 304, 155, 411),
    ("rv32imac", "float32", "size"): (723, 146, 738, 625, 79, 0, 206, 139, 397),
    ("rv32imac", "float32", "speed"): (786, 136, 197, 581, 206, 0, 163, 119, 453),
    ("rv32imac", "float64", "size"): (0, 222, 734, 892, 124, 702, 215, 168, 421),
    ("rv32imac", "float64", "speed"): (327, 213, 306, 854, 140, 605, 245, 173, 505),
    ("rv32imafc", "float32", "size"): (353, 91, 421, 363, 248, 123, 131, 99, 365),
    ("rv32imafc", "float32", "speed"): (60, 90, 109, 361, 263, 74, 167, 94, 425),
}
INTEGERS: dict[str, tuple[int, ...]] = {
    "cortex-m0": (0, 74, 453, 496, 138, 0, 41, 488),
    "cortex-m4f": (0, 48, 463, 259, 256, 0, 0, 112),
    "rv32imac": (0, 95, 281, 312, 0, 0, 0, 203),
}
