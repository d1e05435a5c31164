"""Telemetry in, decisions out, and the log of both."""
