"""Many points side by side: systems that differ by numbers only, solved with shared tables and grids."""
