"""Witnesses for the sampled, rounded loop of identical controllers, mode by mode."""
