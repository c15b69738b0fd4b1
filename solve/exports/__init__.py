"""Linearised and nonlinear equations in the forms of other tools."""
