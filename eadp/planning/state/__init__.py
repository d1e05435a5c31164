"""Estimates from what a flight has measured so far."""
