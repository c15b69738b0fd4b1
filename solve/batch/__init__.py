"""Batch solution of many points, that is, of systems that differ only in parameter values, with shared tables
and grids."""
