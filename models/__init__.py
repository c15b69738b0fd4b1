"""Mechanisms, one per folder. `derive` and `solve` locate them by path."""
