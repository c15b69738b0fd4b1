"""Figures and tables of the four-bar linkage."""
