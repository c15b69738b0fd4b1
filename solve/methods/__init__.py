"""Discretisation methods, one per file."""
