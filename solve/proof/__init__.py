"""Rigorous enclosures of periodic solutions and Floquet multipliers by ball arithmetic."""
