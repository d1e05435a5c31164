"""The forecast: time, charge and quality of what is left of a mission, at many path parameters at once."""
