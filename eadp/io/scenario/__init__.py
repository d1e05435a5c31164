"""Scenario files in."""
