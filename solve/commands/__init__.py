"""Commands of `solve`. Heavy packages are imported when a command runs."""
