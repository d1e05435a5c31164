"""Autopilots' logs: their kinds by their first bytes, and their messages as tables of numbers."""
