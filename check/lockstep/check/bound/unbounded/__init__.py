"""Unbounded domains: tails, charts at infinity, a period of t, and the relaxation that is decided there."""
