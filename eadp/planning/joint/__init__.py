"""Path and computations together, to the end of the mission."""
