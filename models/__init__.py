"""What each mechanism is, one a folder; `derive` and `solve` find them by path, never by name."""
