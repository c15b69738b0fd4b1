"""Grid refinement and error estimates."""
