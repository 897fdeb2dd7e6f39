"""C controllers from gains: emit, compile, and compare bit by bit with the Python reference.

The steps, one module each: `spec` (what is asked for), `kernel` (CasADi's instruction list as C statements), `emit` (the
folder as text), `folder` (written atomically); `lockstep.verification` compiles, runs and compares.
"""
