"""Random command lines over all commands: none may end but in a result or in one line."""
