"""Flight: aerodynamics, battery, wind triangle, guiding vector field."""
