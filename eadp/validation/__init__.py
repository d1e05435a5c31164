"""Geometric checks of a plan over the whole range of its parameters."""
