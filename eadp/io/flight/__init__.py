"""A flight: its inputs together, its result folder out."""
