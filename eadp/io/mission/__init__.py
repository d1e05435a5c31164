"""Missions of other software: read as plans, and plans written as missions."""

EXPORT_NAMES = ("qgc", "ardupilot", "paparazzi", "kml", "geojson", "gpx")
"""Formats that a plan is exported to; `export.EXPORTS` holds what writes them."""
