"""A place on the earth, of tests and of an example, which needs none of the libraries of tests."""

ORIGIN = (55.37, 10.43)
"""Latitude and longitude [°]."""
