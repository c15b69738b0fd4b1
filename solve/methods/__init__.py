"""Methods that turn one period into a map, one a file."""
