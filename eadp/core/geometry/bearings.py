"""Angles of pilots and of the papers: compass bearings [°] in files and output, mathematical angles [rad] inside."""

from __future__ import annotations

import math


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
