"""Studies, each of which combines many solutions; one study per file."""
