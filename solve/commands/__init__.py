"""Commands of `solve`. Large packages are imported only when a command runs."""
