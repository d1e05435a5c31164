"""Numbers with bounds, for the fields of settings: readers of files check them, schemas print them."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Finite = Annotated[float, Ge(-1e9), Le(1e9)]
Share = Annotated[float, Ge(0), Le(1)]
Efficiency = Annotated[float, Gt(0), Le(1)]
Degrees = Annotated[float, Ge(-360), Le(360)]
Latitude = Annotated[float, Ge(-90), Le(90)]
Longitude = Annotated[float, Ge(-180), Le(180)]
Coordinate = Annotated[float, Ge(-1e7), Le(1e7)]
Seconds = Annotated[float, Ge(0), Le(1e9)]
Duration = Annotated[float, Gt(0), Le(1e9)]
Watts = Annotated[float, Ge(0), Le(1e6)]
MetresPerSecond = Annotated[float, Ge(0), Le(100)]
"""Wind: the fastest gust measured near the ground is 113 m/s, of a cyclone."""
Altitude = Annotated[float, Ge(-1e3), Le(3e4)]
"""From below the lowest land to above the highest flights on propellers."""
Reserve = Annotated[float, Ge(0), Lt(1)]
