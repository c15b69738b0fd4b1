"""What each mechanism is, one a folder; found by path, and imported only by tests."""
