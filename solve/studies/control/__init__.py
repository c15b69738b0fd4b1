"""Feedback control of periodic systems: Riccati equations, gains and closed loops."""
