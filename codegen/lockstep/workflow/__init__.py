"""What `import lockstep` offers and the command line calls: a module for each step, from a problem file to its report.

Every function computes first and writes last, refuses an output that cannot be written before anything is computed,
and returns an object whose `document()` is what the command prints with `--json`. Nothing here prints.
"""
