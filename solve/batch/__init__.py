"""Batch solution of many points (systems that differ only in parameter values) with shared tables and
grids."""
