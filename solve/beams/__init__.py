"""Plane structures of beams in general: their matrices, exact dynamic stiffness and frequencies."""
