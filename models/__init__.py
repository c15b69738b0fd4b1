"""Mechanisms, one per folder. `derive` and `solve` find them by path."""
