"""Many flights: design, engines, statistics."""
