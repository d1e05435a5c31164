"""Coordinates of a reference system as longitude and latitude.

This is the one door to pyproj (the extra `fields`), imported where a file states such a system.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from eadp.core.geometry.curves import Point
from eadp.errors import InputError

ToDegrees = Callable[[float, float], Point | None]
"""Longitude and latitude [°, WGS-84] of coordinates; None outside the system."""


def degrees_of(code: tuple[str, str], name: str, error: Callable[[str, str], InputError], otherwise: str) -> ToDegrees:
    """What makes degrees of the coordinates of a reference system.

    Parameters
    ----------
    code : (str, str)
        An authority and its code, as EPSG and 25832.
    name : str
        For messages.
    error : function of a message and what is expected
    otherwise : str
        What is expected instead.

    Raises
    ------
    InputError
        If the extra is not installed, or the system is not known, or not related to WGS-84.
    """
    try:
        import pyproj
        from pyproj.exceptions import ProjError
    except ImportError:
        message = "pyproj, which converts coordinates, is missing"
        raise error(message, f"pip install 'eadp[fields]', or {otherwise}") from None
    try:
        known = pyproj.CRS.from_authority(*code)
        if not (known.is_projected or known.is_geographic):
            raise ProjError("neither projected nor geographic")
        # without a known datum PROJ takes it as WGS-84, which may be hundreds of metres off
        transform = pyproj.Transformer.from_crs(known, 4326, always_xy=True, allow_ballpark=False).transform
    except ProjError:
        raise error(f"the reference system {name} is not known", otherwise) from None

    def to_degrees(x: float, y: float) -> Point | None:
        longitude, latitude = transform(x, y)
        if not (math.isfinite(longitude) and math.isfinite(latitude)):
            return None
        return round(longitude, 9), round(latitude, 9)

    return to_degrees
