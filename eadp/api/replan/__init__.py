"""What `eadp replan` does: a flight re-planned on telemetry, on a link, or again from a log."""
