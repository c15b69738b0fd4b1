"""Costs of solutions relative to alternatives that a user might write. Ratios are printed, never asserted."""
