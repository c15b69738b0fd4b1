"""Results as data: columns, values, warnings and files."""
