"""Refinement and error estimates: each rule once, over points."""
