"""The plan: stages, structure, where a flight is in it (cursor) and what is left of it (route)."""
