"""The commands, one a file; heavy packages are imported when a command runs, not before."""
