"""Studies that consist of many solutions, one per file."""
