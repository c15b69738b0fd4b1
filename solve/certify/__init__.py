"""Grid refinement, and error estimates of solutions."""
