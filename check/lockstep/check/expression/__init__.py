"""Exact expressions: text to nodes, what their operations mean, and what can be done with them."""
