"""An open benchmark: thirty periodic linear systems as data, with multipliers and orbits to 30 digits."""
