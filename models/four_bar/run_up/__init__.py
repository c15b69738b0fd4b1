"""A run-up over speed and L4: the map of stresses, paths below an allowable one, the simulated ramp."""
