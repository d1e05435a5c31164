"""Digital elevation models in: GeoTIFF and SRTM."""
