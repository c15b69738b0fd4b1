"""Studies of `python -m models.four_bar`. Each is a module with its computation, result and command."""
