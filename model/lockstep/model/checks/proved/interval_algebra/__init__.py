"""Matrices of intervals, and what is decided of them on a box: definiteness, eigenvalues."""
