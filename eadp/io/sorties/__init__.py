"""Sorties: a field divided among flights, their folder, their flights, and what is left of it."""
