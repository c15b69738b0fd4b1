"""Plane beam structures: matrices, exact dynamic stiffness and natural frequencies."""
