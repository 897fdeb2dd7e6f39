"""The paper's Section 4 again: figures 3, 4, 5 and Table 2 with its gains, with certified ones, and with [25]."""
