"""Fields in: GeoJSON, KML, CSV of vertices."""
