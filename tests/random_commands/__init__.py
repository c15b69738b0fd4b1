"""Random command lines for all commands: each must end with a result or a one-line error."""
