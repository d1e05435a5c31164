"""Pictures: the only matplotlib door."""
