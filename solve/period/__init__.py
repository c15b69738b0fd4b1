"""One period: grid, curve, statistics, period map and multipliers, with a leading axis of points."""
