"""What `eadp fit` does: the power of a log, its battery, its aircraft."""
