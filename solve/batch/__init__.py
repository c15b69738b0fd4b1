"""Batch solution of many points: systems that differ in parameter values only, with shared tables and
grids."""
