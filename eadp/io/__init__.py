"""Files in and out: text, YAML, CSV, JSON, figures."""
