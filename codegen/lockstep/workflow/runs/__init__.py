"""Runs of a design: simulations, responses, and campaigns of many of them against what is proved."""
