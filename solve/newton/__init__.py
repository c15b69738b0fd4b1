"""The nonlinear orbit: a loop of linear periodic problems, and ways to where it converges."""
