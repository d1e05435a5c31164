"""Plan text in and out."""
