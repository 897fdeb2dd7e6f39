"""The closed loop as C for many runs at a time: emitted from CasADi functions, compiled, called batch by batch."""
