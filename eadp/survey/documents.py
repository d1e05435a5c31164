"""Documents that `eadp cover` and the flights of sorties write, as the functions return them that write them.

`eadp schema cover`, `sorties` and `job` print their JSON Schemas; docs/results.md has the keys' meanings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from eadp.core.geometry.curves import Point


class PicturesKeys(TypedDict):
    """Of a camera; None of each without one."""

    forward_overlap: float | None
    pictures: int | None
    gsd_cm: float | None
    camera: dict[str, str | float | None] | None


class LeftKeys(TypedDict):
    """A place that is not covered."""

    area_m2: float
    at_m: Point
    at_deg: list[float] | None
    share: NotRequired[float]


class TerrainKeys(TypedDict):
    """Heights above the ground."""

    zero_m: float
    ground_m: list[float]
    height_m: list[float]
    height_elsewhere_m: float | None
    higher_share: float
    altitudes: int
    home_altitude_m: int
    gsd_cm: list[float] | None
    side_overlap: list[float] | None


class _LowestKeys(TypedDict):
    length_m: float
    time_s: float
    lines: int
    energy_wh: NotRequired[float | None]


class PathKeys(TypedDict):
    """A path, of `eadp.cover/1`."""

    schema: Literal["eadp.cover/1"]
    pattern: str
    heading_deg: float
    coverage: float
    coverage_min: float
    length_m: float
    time_s: float
    lines: int
    spacing_m: list[float | None]
    swath_m: float
    lead_in_m: float
    min_radius_m: float | None
    c1: list[float] | None
    at_lowest_c1: _LowestKeys
    c1_steps: list[float]
    blocks: int
    parts: int
    obstacles: int
    boundary: bool
    origin_deg: Point | None
    field: dict[str, float | str]
    left: list[LeftKeys]
    normalised: list[str]
    plan: str
    energy_wh: NotRequired[float]


class SlowerKeys(TypedDict):
    """The densest lines at the airspeeds of the least energy."""

    airspeeds_mps: list[float]
    time_s: float | None
    energy_wh: float | None


class CoverDocument(PathKeys, PicturesKeys):
    """`eadp.cover/1`."""

    side_overlap: list[float | None]
    batteries: list[float] | None
    slower: SlowerKeys | None
    terrain: TerrainKeys | None


class SortieRow(TypedDict):
    """The figures of a sortie."""

    sortie: str
    plan: str
    take_off_s: float
    lines: int
    spacing_m: float | None
    length_m: float
    pictures: int | None
    time_s: float
    time_std_s: float
    energy_wh: float
    energy_std_wh: float
    soc_end: float
    soc_end_std: float
    reserve_probability: float


class SortiesDocument(PicturesKeys):
    """`eadp.sorties/1`."""

    schema: Literal["eadp.sorties/1"]
    file: str
    field: dict[str, float | str]
    pattern: str
    heading_deg: float
    origin_deg: Point | None
    home_m: Point | None
    swath_m: float
    count: int
    energy_wh: float
    length_m: float
    time_s: float
    coverage: float
    left: list[LeftKeys]
    swap_s: float
    overlap_m: float
    terrain: TerrainKeys | None
    options: dict[str, Any]
    sorties: list[SortieRow]
    parts: Sequence[Sequence[Sequence[Point]]]


class FlownRow(TypedDict):
    """The figures of a flight of a job."""

    sortie: str
    take_off_s: float
    completed: bool
    reason: str
    duration_s: float
    energy_wh: float
    distance_m: float
    soc_final: float
    reserve_kept: bool
    quality: float | None


class JobDocument(TypedDict):
    """`eadp.job/1`."""

    schema: Literal["eadp.job/1"]
    completed: bool
    reason: str
    batteries: int
    coverage: float
    planned_coverage: float
    left: list[LeftKeys]
    duration_s: float
    distance_m: float
    energy_wh: float
    soc_final: float
    reserve_kept: bool
    quality: float | None
    replans: int
    solver: dict[str, int]
    flights: list[FlownRow]
    origin_deg: Point | None
    seed: int
