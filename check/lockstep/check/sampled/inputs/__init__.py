"""Inputs that have limits: from where none is met, and loops whose inputs are clipped."""
