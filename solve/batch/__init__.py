"""Batch solution of many points: systems that differ in numbers only, with shared tables and grids."""
