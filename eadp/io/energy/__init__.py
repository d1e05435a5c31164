"""Energy models in and out."""
