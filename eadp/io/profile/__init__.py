"""Computation profiles: measurements in, the model in and out."""
