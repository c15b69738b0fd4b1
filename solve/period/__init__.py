"""Grid, curve, statistics, period map and multipliers of one period. Arrays have a leading axis of points."""
