"""Frozen dataclasses: what the domain talks about. No files, no solver."""
