"""The studies of `python -m models.four_bar`: one module each, with computation, result and command."""
