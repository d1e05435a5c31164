"""Missions of other software: read as plans, and plans written as missions."""

ENDINGS = {
    "qgc": ".plan",
    "ardupilot": ".waypoints",
    "paparazzi": ".xml",
    "kml": ".kml",
    "geojson": ".geojson",
    "gpx": ".gpx",
}
"""Endings of the names of files, by format."""

EXPORT_NAMES = tuple(ENDINGS)
"""Formats that a plan is exported to; `export.EXPORTS` holds what writes them."""
