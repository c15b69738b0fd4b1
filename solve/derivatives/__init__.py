"""Exact derivatives of orbits and multipliers with respect to parameters and speed, computed on the grid of
the solution."""
