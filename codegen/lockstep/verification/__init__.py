"""The compiled C against its Python reference, bit by bit: compilers, harness, emulated cores, software in the loop."""
