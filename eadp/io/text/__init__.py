"""Text: streams, places (line and column), YAML, JSON, CSV."""
