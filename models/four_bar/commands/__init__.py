"""What `python -m models.four_bar` can do, one file a command."""
