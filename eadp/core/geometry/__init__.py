"""Plane geometry: lines, circles, curves, Dubins paths, polygons, and the local frame on the earth."""
