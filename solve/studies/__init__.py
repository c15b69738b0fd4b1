"""Studies that combine many solutions, one study per file."""
