"""Batch solution of many points with shared tables and grids. The points are systems that differ only in
parameter values and speed."""
