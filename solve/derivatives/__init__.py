"""How orbits and multipliers change with parameters and the speed, exactly, on the grid that solved them."""
