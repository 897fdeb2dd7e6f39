"""What C is compiled with and runs on: compilers, the host, emulated microcontrollers."""
