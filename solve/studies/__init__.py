"""What several solutions together tell, one study a file."""
