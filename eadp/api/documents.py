"""Documents of plans and flights, as the functions return them that write them; docs/results.md has the keys' meanings.

`eadp schema` prints their JSON Schemas.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, NotRequired, get_type_hints

from annotated_types import Len
from typing_extensions import TypedDict

from eadp.io.text.yaml import document_schema
from eadp.planning.base import DecisionRecord, Ending

Point = Annotated[list[float], Len(2, 2)]


class PlanSet(TypedDict):
    name: str
    kind: str
    min: float
    max: float


class PlanStage(TypedDict):
    index: int
    line: int
    gain: float
    rotation_deg: float
    path: str
    kind: str
    trigger: dict[str, float | str]
    sets: list[PlanSet]
    altitude_m: NotRequired[float]
    airspeed_mps: NotRequired[float]
    commands: NotRequired[Sequence[Sequence[float]]]


class PlanParameter(TypedDict):
    name: str
    kind: str
    title: str
    unit: str
    stands_for: str | None


class PlanFinding(TypedDict):
    severity: str
    stage: int | None
    line: int
    code: str
    message: str
    formula: NotRequired[str]
    proven: NotRequired[bool]


class PlanSegment(TypedDict):
    first: int
    stages: int
    repeats: bool
    until: str | None


class PlanDocument(TypedDict):
    schema: Literal["eadp.plan/1"]
    stages: list[PlanStage]
    repeats: bool
    shift: list[float | str] | None
    primitive_stages: int | None
    final: dict[str, float | str]
    parameters: list[PlanParameter]
    trigger_radius_m: float
    min_radius_m: float | None
    origin_deg: Sequence[float] | None
    findings: list[PlanFinding]
    start_m: NotRequired[Sequence[float]]
    field: NotRequired[dict[str, float | str]]
    camera: NotRequired[dict[str, float | str | None]]
    segments: NotRequired[list[PlanSegment]]
    valid: NotRequired[bool]  # of --check, as those below
    leads_on: NotRequired[list[dict[str, float] | None]]
    proofs: NotRequired[list[dict[str, str | bool | None]]]


class _Power(TypedDict):
    mean: float | None
    min: float | None
    max: float | None


class _Shown(TypedDict):
    mean: float
    first: float
    last: float


class ParameterSummary(_Shown):
    changes: int
    actual_mean: NotRequired[float]
    changes_at: NotRequired[Sequence[Point]]
    title: NotRequired[str]
    unit: NotRequired[str]
    shown: NotRequired[_Shown | None]


class Endurance(TypedDict):
    parameters: dict[str, float]
    computing_w: float
    power_w: float
    time_s: float | None


class Endurances(TypedDict):
    motion_w: float
    lowest: Endurance
    flown: Endurance
    highest: Endurance
    gain_min_per_h: float | None


class _Solver(TypedDict):
    calls: int
    solved: int
    retried: int
    failed: int
    fallbacks: int
    closed_form_better: int
    skipped: int
    infeasible: int
    by_status: dict[str, int]
    gap_max: float | None
    median_ms: NotRequired[float | None]  # on standard output; a folder has them in timings.json
    max_ms: NotRequired[float | None]


class Timings(TypedDict):
    schema: Literal["eadp.timings/1"]
    solver: dict[str, float | None]


class FileList(TypedDict):
    schema: Literal["eadp.files/1"]
    files: list[str]


class _Entry(TypedDict):
    name: str
    entered_s: float
    inside_m: float


class _Risk(TypedDict):
    name: str
    probability: float


class _StageForecast(TypedDict):
    stage: int
    time_s: float
    energy_wh: float


class _Cruise(TypedDict):
    airspeed_mps: float
    completes_probability: float | None
    time_s: float | None
    soc_end: float | None
    quality: float | None


class EnergyForecast(TypedDict):
    completes: bool
    completes_probability: float | None
    reserve_probability: float | None
    time_s: float | None
    time_std_s: float | None
    energy_wh: float | None
    energy_std_wh: float | None
    computing_wh: float | None
    soc_end: float | None
    soc_end_std: float | None
    parameters: dict[str, float]
    quality: float | None
    turn_back_s: float | None
    turn_back_m: Point | None
    batteries: int | None
    reach_share: float | None
    reach_s: float | None
    reach_m: Point | None
    obstacles: list[_Risk]
    stages: list[_StageForecast]
    autopilot: NotRequired[str]
    airspeeds_mps: NotRequired[list[float]]
    at_cruise: NotRequired[_Cruise | None]


class Summary(TypedDict):
    schema: Literal["eadp.flight/1"]
    completed: bool
    reserve_kept: bool
    turned_back_s: float | None
    turned_back_m: Point | None
    reason: str
    battery_limit: str | None
    planner: str
    field: dict[str, float | str] | None
    duration_s: float
    distance_m: float
    energy_wh: float
    power_w: _Power
    soc_final: float
    soc_reserve: float
    period_s: float | None
    lap_times_s: list[float]
    parameters: dict[str, ParameterSummary]
    quality: float | None
    coverage: float | None
    obstacles: list[_Entry]
    paper_metric: float | None
    endurance: Endurances | None
    decisions: int
    replans: int
    solver: _Solver
    energy_forecast: EnergyForecast | None
    never_past: str | None
    seed: int


def decisions() -> dict[str, Any]:
    """JSON Schema of a line of `decisions.jsonl`."""
    keys = get_type_hints(DecisionRecord) | get_type_hints(Ending) | {"parameters": dict[str, float]}
    del keys["ending"]
    return document_schema("eadp.decisions/1", keys, labelled=False)
