"""The four-bar linkage of the thesis: its rigid motion, classes, joint forces and pictures."""
