"""A generated module with its numbers as a system: cases, options, bounds, sampling."""
