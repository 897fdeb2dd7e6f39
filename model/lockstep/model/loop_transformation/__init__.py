"""Slopes moved from phi into A, exactly: the same agent with a smaller bound, or linearised at the origin."""
