"""The world that the planner flies in."""
