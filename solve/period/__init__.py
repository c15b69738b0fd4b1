"""What one period is: grid, curve, statistics, period map, multipliers; with a leading axis of points."""
