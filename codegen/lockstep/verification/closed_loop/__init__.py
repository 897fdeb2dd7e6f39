"""The compiled C in the loop with the nonlinear agents, and a run of it held against what is proved."""
