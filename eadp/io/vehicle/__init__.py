"""Vehicle files in."""
