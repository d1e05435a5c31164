"""A live link with an autopilot: MAVLink in, decisions out."""
