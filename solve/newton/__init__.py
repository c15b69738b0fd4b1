"""Nonlinear orbits by Newton's method, and strategies that supply its initial guess. Each iteration solves a
linear periodic problem."""
