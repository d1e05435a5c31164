"""Missions of other software: read as plans, and plans written as missions."""
