"""The rigid linkage: its class, closed form, forces, pictures and report (thesis Chapter 3)."""
