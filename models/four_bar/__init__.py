"""Four-bar linkage of the thesis: rigid motion, classes, joint forces, studies and pictures."""
