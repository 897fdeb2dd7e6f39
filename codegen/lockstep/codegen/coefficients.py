"""Coefficients of the bounds that the header states, as `benchmarks/bounds_fit.py` prints them.

Tenths, by the parts of `budget` and `bounds`; above measurements with head room: 10 % and 16 bytes, 30 % of instructions.
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
    ("cortex-m0", "float32", "size"): (2584, 64, 43, 0, 867, 21, 2, 633, 2),
    ("cortex-m0", "float32", "speed"): (2077, 109, 0, 3, 832, 31, 0, 180, 0),
    ("cortex-m0", "float64", "size"): (2053, 173, 266, 0, 1404, 0, 80, 851, 0),
    ("cortex-m0", "float64", "speed"): (2485, 207, 0, 7, 978, 59, 0, 163, 0),
    ("cortex-m4f", "float32", "size"): (1116, 92, 83, 0, 268, 2, 42, 383, 0),
    ("cortex-m4f", "float32", "speed"): (1067, 41, 19, 10, 379, 8, 15, 537, 0),
    ("cortex-m4f", "float64", "size"): (2376, 118, 439, 0, 1477, 0, 72, 730, 0),
    ("cortex-m4f", "float64", "speed"): (2079, 304, 335, 0, 269, 79, 7, 193, 0),
    ("rv32imac", "float32", "size"): (1764, 65, 221, 0, 814, 0, 13, 456, 0),
    ("rv32imac", "float32", "speed"): (1679, 128, 0, 4, 0, 31, 14, 143, 0),
    ("rv32imac", "float64", "size"): (1705, 199, 255, 0, 780, 0, 60, 826, 0),
    ("rv32imac", "float64", "speed"): (1816, 243, 0, 7, 391, 57, 0, 0, 0),
    ("rv32imafc", "float32", "size"): (1059, 92, 98, 0, 136, 0, 26, 473, 0),
    ("rv32imafc", "float32", "speed"): (741, 86, 2, 45, 0, 10, 14, 606, 0),
}
FLASH: Table = {
    ("cortex-m0", "float32", "size"): (4323, 574, 0, 0, 13447, 174, 373, 4958, 0, 0, 0, 3613, 517, 6),
    ("cortex-m0", "float32", "speed"): (0, 0, 0, 292, 18264, 343, 179, 9883, 0, 4425, 0, 2062, 998, 116),
    ("cortex-m0", "float64", "size"): (0, 1033, 0, 0, 12020, 103, 269, 6927, 3754, 5388, 523, 0, 2560, 13),
    ("cortex-m0", "float64", "speed"): (0, 1348, 0, 401, 8599, 392, 89, 14349, 634, 4533, 470, 12283, 0, 0),
    ("cortex-m4f", "float32", "size"): (0, 610, 0, 0, 12226, 311, 424, 4768, 5780, 7982, 0, 0, 1540, 0),
    ("cortex-m4f", "float32", "speed"): (0, 136, 0, 211, 12435, 395, 422, 8627, 6310, 7890, 0, 0, 1762, 0),
    ("cortex-m4f", "float64", "size"): (0, 1129, 0, 0, 25099, 283, 470, 1949, 0, 7118, 0, 274, 1364, 222),
    ("cortex-m4f", "float64", "speed"): (
        5676,
        1596,
        0,
        440,
        2794,
        1316,
        0,
        21932,
        3183,
        0,
        0,
        2332,
        1478,
        216,
    ),
    ("rv32imac", "float32", "size"): (0, 918, 4185, 0, 15868, 0, 0, 0, 0, 1730, 0, 13221, 1129, 124),
    ("rv32imac", "float32", "speed"): (5017, 988, 0, 428, 3195, 1022, 0, 0, 0, 0, 0, 11567, 1513, 0),
    ("rv32imac", "float64", "size"): (1635, 2056, 4579, 0, 11622, 206, 0, 0, 0, 0, 0, 0, 4207, 0),
    ("rv32imac", "float64", "speed"): (0, 597, 1088, 691, 9941, 1221, 0, 0, 0, 5269, 0, 7520, 4290, 0),
    ("rv32imafc", "float32", "size"): (0, 763, 909, 0, 15634, 190, 0, 0, 0, 6767, 0, 6822, 798, 150),
    ("rv32imafc", "float32", "speed"): (0, 806, 0, 332, 11975, 518, 0, 0, 1185, 7253, 0, 5761, 945, 0),
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
    "cortex-m0": (110, 72, 0, 0, 2510, 0, 0),
    "cortex-m4f": (179, 17, 0, 0, 2472, 0, 0),
    "cortex-m7": (165, 18, 0, 0, 2472, 0, 0),
    "rv32imac": (205, 17, 0, 0, 3425, 0, 0),
    "rv32imafc": (205, 17, 0, 0, 3425, 0, 0),
}
