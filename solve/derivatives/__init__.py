"""Exact derivatives of orbits and multipliers by parameters and the speed, on the grid of the solution."""
