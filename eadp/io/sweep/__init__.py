"""Sweeps: the sweep file in, the results file in and out."""
