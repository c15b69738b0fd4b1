"""Systems from a generated module and its parameter values: cases, options, bounds, sampling."""
