"""Mechanisms, one per folder, which `derive` and `solve` locate by path."""
