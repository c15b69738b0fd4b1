"""Studies made of several solutions, one a file."""
