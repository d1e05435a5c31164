"""From a field outline to a plan that covers it."""
