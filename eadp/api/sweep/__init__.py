"""What `eadp sweep` does: many runs, made and kept."""
