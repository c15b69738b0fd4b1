"""Plane structures of beams: matrices, exact dynamic stiffness and natural frequencies."""
