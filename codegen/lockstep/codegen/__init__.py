"""C controllers from gains: emit, compile, and compare bit by bit with the Python reference.

The steps, one module each: `spec` (what is asked for), `kernel` (CasADi's instruction list as C statements), `emit` (the
folder as text), `folder` (written atomically), `reference` (the same arithmetic in NumPy), `verify` (compile, run,
compare). The gains are sampled and rounded by `lockstep.check.sampled.discretise`.
"""
