"""Commented problem files, one per field, that `lockstep init` begins from: parameters with their source."""
