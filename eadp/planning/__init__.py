"""What decides: from an Observation to a Decision, from telemetry alone."""
