"""Coefficients of the bounds that the header states, as `benchmarks/bounds_fit.py` prints them: tenths, by the parts of
`budget` and `bounds`; and the most instructions of a routine of soft arithmetic, as `benchmarks/bounds.py library` finds them.

Above measurements with head room: 5 % and 16 bytes, and 30 % of instructions.
"""

from lockstep.check.sampled.discretise import Real
from lockstep.codegen.spec import Optimize

Table = dict[tuple[str, Real, Optimize], tuple[int, ...]]

# sums, v - v, sums of 0 and NaN, products, comparisons: the most that was found, in compiler-rt and libgcc
ROUTINES: dict[tuple[str, Real], tuple[int, ...]] = {
    ("cortex-m0", "float32"): (178, 137, 55, 172, 43),
    ("cortex-m0", "float64"): (418, 279, 110, 517, 71),
    ("cortex-m4f", "float64"): (179, 115, 55, 680, 57),
    ("cortex-m7", "float64"): (179, 115, 55, 680, 57),
    ("rv32imac", "float32"): (180, 130, 38, 139, 31),
    ("rv32imac", "float64"): (267, 177, 45, 223, 44),
    ("rv32imafc", "float64"): (267, 177, 45, 223, 44),
}
STACK: Table = {
    ("cortex-m0", "float32", "size"): (1582, 89, 175, 0, 864, 0, 18, 560, 0),
    ("cortex-m0", "float32", "speed"): (1711, 132, 0, 3, 575, 18, 0, 372, 0),
    ("cortex-m0", "float64", "size"): (1954, 171, 228, 0, 935, 0, 112, 43, 0),
    ("cortex-m0", "float64", "speed"): (1966, 302, 0, 2, 690, 12, 36, 0, 0),
    ("cortex-m4f", "float32", "size"): (873, 85, 132, 0, 372, 0, 14, 354, 0),
    ("cortex-m4f", "float32", "speed"): (1013, 33, 34, 10, 369, 2, 19, 242, 0),
    ("cortex-m4f", "float64", "size"): (1685, 155, 430, 0, 901, 0, 62, 715, 0),
    ("cortex-m4f", "float64", "speed"): (1459, 322, 236, 0, 880, 17, 78, 127, 0),
    ("rv32imac", "float32", "size"): (959, 96, 286, 0, 583, 0, 5, 441, 0),
    ("rv32imac", "float32", "speed"): (1177, 162, 0, 3, 347, 7, 22, 0, 0),
    ("rv32imac", "float64", "size"): (1282, 161, 406, 0, 890, 0, 0, 951, 0),
    ("rv32imac", "float64", "speed"): (1447, 227, 0, 7, 725, 14, 0, 525, 0),
    ("rv32imafc", "float32", "size"): (570, 98, 170, 0, 239, 0, 0, 388, 0),
    ("rv32imafc", "float32", "speed"): (676, 61, 57, 44, 0, 3, 0, 603, 0),
}
FLASH: Table = {
    ("cortex-m0", "float32", "size"): (0, 576, 1321, 0, 5954, 14, 960, 5787, 4408, 2773, 0, 927, 306, 0),
    ("cortex-m0", "float32", "speed"): (2967, 1321, 0, 212, 10628, 211, 698, 4362, 0, 0, 0, 0, 157, 0),
    ("cortex-m0", "float64", "size"): (0, 942, 2909, 0, 5809, 0, 1327, 8878, 7124, 2260, 0, 0, 268, 4),
    ("cortex-m0", "float64", "speed"): (0, 1183, 904, 394, 5203, 206, 1420, 0, 0, 3501, 172, 5914, 0, 0),
    ("cortex-m4f", "float32", "size"): (0, 559, 994, 0, 7141, 99, 813, 3005, 2655, 6645, 0, 3268, 81, 103),
    ("cortex-m4f", "float32", "speed"): (7654, 0, 0, 205, 6995, 181, 840, 0, 745, 0, 0, 10383, 0, 133),
    ("cortex-m4f", "float64", "size"): (0, 1068, 4114, 0, 3107, 123, 1209, 8206, 11213, 2673, 0, 0, 0, 3),
    ("cortex-m4f", "float64", "speed"): (0, 1719, 2690, 410, 2226, 950, 566, 17006, 7866, 2528, 0, 686, 0, 0),
    ("rv32imac", "float32", "size"): (3054, 1009, 2454, 0, 6684, 120, 185, 0, 2962, 0, 0, 5944, 0, 124),
    ("rv32imac", "float32", "speed"): (0, 0, 4458, 465, 1914, 494, 0, 6054, 4641, 1214, 0, 6088, 0, 0),
    ("rv32imac", "float64", "size"): (6252, 1623, 0, 0, 5828, 765, 0, 0, 3907, 0, 0, 11945, 0, 0),
    ("rv32imac", "float64", "speed"): (0, 1594, 3503, 589, 2523, 1046, 0, 0, 14137, 1598, 0, 0, 0, 0),
    ("rv32imafc", "float32", "size"): (4789, 935, 2076, 0, 0, 120, 381, 0, 7403, 251, 0, 0, 0, 0),
    ("rv32imafc", "float32", "speed"): (0, 0, 3120, 370, 3774, 223, 86, 4941, 6320, 4516, 0, 0, 0, 0),
}
OWN: Table = {
    ("cortex-m0", "float32", "size"): (0, 144, 834, 465, 523, 0, 325, 265, 483),
    ("cortex-m0", "float32", "speed"): (3, 90, 208, 489, 264, 0, 419, 204, 958),
    ("cortex-m0", "float64", "size"): (0, 241, 551, 285, 2496, 185, 1014, 215, 414),
    ("cortex-m0", "float64", "speed"): (0, 158, 243, 605, 740, 0, 799, 219, 683),
    ("cortex-m4f", "float32", "size"): (0, 110, 420, 289, 316, 0, 356, 104, 178),
    ("cortex-m4f", "float32", "speed"): (17, 50, 0, 384, 0, 194, 245, 143, 547),
    ("cortex-m4f", "float64", "size"): (0, 178, 716, 610, 272, 31, 630, 178, 0),
    ("cortex-m4f", "float64", "speed"): (0, 159, 181, 525, 633, 0, 514, 139, 0),
    ("rv32imac", "float32", "size"): (0, 145, 842, 491, 343, 200, 0, 138, 208),
    ("rv32imac", "float32", "speed"): (0, 132, 288, 477, 418, 0, 187, 115, 165),
    ("rv32imac", "float64", "size"): (0, 228, 481, 149, 2449, 580, 417, 259, 279),
    ("rv32imac", "float64", "speed"): (0, 217, 230, 439, 1354, 22, 526, 248, 0),
    ("rv32imafc", "float32", "size"): (0, 79, 678, 288, 248, 0, 0, 111, 190),
    ("rv32imafc", "float32", "speed"): (174, 100, 0, 245, 427, 0, 228, 102, 222),
}
INTEGERS: dict[str, tuple[int, ...]] = {}
