"""Export of linearised and nonlinear equations in the formats of other tools."""
