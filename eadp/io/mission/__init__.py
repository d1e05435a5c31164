"""Missions of other software: read as plans, and plans written as missions."""

ENDINGS = {
    "qgc": ".plan",
    "ardupilot": ".waypoints",
    "px4": ".plan",
    "paparazzi": ".xml",
    "kml": ".kml",
    "geojson": ".geojson",
    "gpx": ".gpx",
}
"""Endings of the names of files, by format."""

WITH_ITEMS = ("qgc", "ardupilot", "px4")
"""Formats of missions of items; a map of these to the plan's stages is written beside the mission."""

ITEMS_ENDING = ".items.json"
"""Ending of the map's name, after that of the mission."""

FENCE_ENDING = ".fence.waypoints"
"""Ending of the name of ArduPilot's fence, after that of the mission."""

EXPORT_NAMES = tuple(ENDINGS)
"""Formats that a plan is exported to; `export.EXPORTS` holds what writes them."""
