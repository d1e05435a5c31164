"""eadp: energy-aware dynamic planning of a fixed-wing robot's flight and of its onboard computing."""

__version__ = "0.1.0"
