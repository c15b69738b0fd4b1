"""Exact derivatives of orbits and multipliers with respect to parameters and the speed, on the grid of the
solution."""
