"""The local frame on the earth: a tangent plane at an origin on the WGS-84 ellipsoid.

Source: the usual conversions between geodetic coordinates, earth-centred ones and a local east-north-up frame (NIMA
TR8350.2 for the ellipsoid's constants; Bowring's start and Newton-like steps for the latitude).
"""

from __future__ import annotations

import math

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
_E2 = FLATTENING * (2 - FLATTENING)

FARTHEST_M = 100_000.0
"""Largest distance from the origin [m]: beyond it the tangent plane is distorted by more than 1 part in 8,000, and
coordinates are those of another grid."""


def to_geodetic_deg(east_m: float, north_m: float, origin_deg: tuple[float, float]) -> tuple[float, float]:
    """Latitude and longitude of a point of the tangent plane.

    Parameters
    ----------
    east_m, north_m : float
        In the plane that touches the ellipsoid at the origin [m].
    origin_deg : (float, float)
        Latitude and longitude of the origin [°].

    Returns
    -------
    latitude, longitude : float
        Of the point of the ellipsoid below it [°].
    """
    x0, y0, z0 = _earth_centred_m(*origin_deg)
    lat, lon = (math.radians(value) for value in origin_deg)
    # the plane's axes, east and north, in earth-centred coordinates
    x = x0 - math.sin(lon) * east_m - math.sin(lat) * math.cos(lon) * north_m
    y = y0 + math.cos(lon) * east_m - math.sin(lat) * math.sin(lon) * north_m
    z = z0 + math.cos(lat) * north_m
    return _latitude_deg(math.hypot(x, y), z), math.degrees(math.atan2(y, x))


def to_local_m(latitude_deg: float, longitude_deg: float, origin_deg: tuple[float, float]) -> tuple[float, float]:
    """East and north of a point of the ellipsoid in the tangent plane at the origin [m]."""
    x0, y0, z0 = _earth_centred_m(*origin_deg)
    x, y, z = _earth_centred_m(latitude_deg, longitude_deg)
    dx, dy, dz = x - x0, y - y0, z - z0
    lat, lon = (math.radians(value) for value in origin_deg)
    east = -math.sin(lon) * dx + math.cos(lon) * dy
    north = -math.sin(lat) * math.cos(lon) * dx - math.sin(lat) * math.sin(lon) * dy + math.cos(lat) * dz
    return east, north


def to_near_local_m(
    latitude_deg: float, longitude_deg: float, origin_deg: tuple[float, float]
) -> tuple[float, float] | None:
    """`to_local_m` of a point within `FARTHEST_M` of the origin; None of any other."""
    point = to_local_m(latitude_deg, longitude_deg, origin_deg)
    # the plane maps both sides of the earth to the same place
    near = abs(latitude_deg - origin_deg[0]) <= 2 and math.cos(math.radians(longitude_deg - origin_deg[1])) >= 0
    return point if near and math.hypot(*point) <= FARTHEST_M else None


def apart_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    """Straight distance through the earth between two points of the ellipsoid, latitude and longitude [m]."""
    return math.dist(_earth_centred_m(*a_deg), _earth_centred_m(*b_deg))


def place_text(position_deg: tuple[float, float]) -> str:
    """A latitude and longitude [°], for people, to about a kilometre."""
    (lat, lon) = position_deg
    return f"{abs(lat):.2f}° {'N' if lat >= 0 else 'S'}, {abs(lon):.2f}° {'E' if lon >= 0 else 'W'}"


def point_text(place_m: tuple[float, float], origin_deg: tuple[float, float] | None) -> str:
    """A place of a local frame, for people: latitude and longitude, to a metre, or metres without an origin."""
    if origin_deg is None:
        return f"({place_m[0]:.0f}, {place_m[1]:.0f}) m"
    lat, lon = to_geodetic_deg(*place_m, origin_deg)
    return f"{lat:.5f},{lon:.5f}"


def _earth_centred_m(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """x, y and z of a point of the ellipsoid [m]."""
    # N = a/√(1 − e² sin² φ), p = N cos φ, z = N (1 − e²) sin φ
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg)
    radius = SEMI_MAJOR_M / math.sqrt(1 - _E2 * math.sin(lat) ** 2)
    across = radius * math.cos(lat)
    return across * math.cos(lon), across * math.sin(lon), radius * (1 - _E2) * math.sin(lat)


def _latitude_deg(across_m: float, z_m: float) -> float:
    """Geodetic latitude [°] of a point `across_m` from the axis and `z_m` above the equator, by fixed-point steps."""
    # p = across_m; the first one is exact on the ellipsoid
    lat = math.atan2(z_m, across_m * (1 - _E2))
    for _ in range(8):
        radius = SEMI_MAJOR_M / math.sqrt(1 - _E2 * math.sin(lat) ** 2)
        # tan φ = (z + e² N sin φ) / p: converges by a factor of e² each step, at any latitude
        lat = math.atan2(z_m + _E2 * radius * math.sin(lat), across_m)
    return math.degrees(lat)


def compass_deg(heading_rad: float) -> float:
    """The compass bearing (0 north, clockwise) of a mathematical angle (0 east, counter-clockwise), in [0, 360) [°]."""
    return (90 - math.degrees(heading_rad)) % 360


def heading_rad(compass_deg: float) -> float:
    """The mathematical angle (0 east, counter-clockwise) of a compass bearing (0 north, clockwise) [rad]."""
    return math.radians((90 - compass_deg) % 360)


def blowing_to_rad(from_deg: float) -> float:
    """The mathematical angle that a wind blows towards, of the compass bearing that it comes from [rad]."""
    return math.radians((270 - from_deg) % 360)


def velocity_mps(speed_mps: float, angle_rad: float) -> tuple[float, float]:
    """The velocity (east, north) of a speed towards a mathematical angle, in m/s."""
    return speed_mps * math.cos(angle_rad), speed_mps * math.sin(angle_rad)
