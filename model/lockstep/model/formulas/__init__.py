"""Formulas as people write them: read into CasADi, written back, their names and usual mistakes in words."""
