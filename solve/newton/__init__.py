"""Nonlinear orbits by Newton's method, a sequence of linear ones, and strategies for its start."""
