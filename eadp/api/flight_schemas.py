"""JSON Schemas of `summary.json` and of the lines of `decisions.jsonl`; docs/results.md has the keys' meanings."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model

from eadp.planning.base import DecisionRecord, Ending

Point = tuple[float, float]
_STRICT = ConfigDict(extra="forbid")


class _Keys(BaseModel):
    model_config = _STRICT


class _FieldKeys(_Keys):
    name: str | None
    area_m2: float


class _Power(_Keys):
    mean: float | None
    min: float | None
    max: float | None


class _Shown(_Keys):
    mean: float
    first: float
    last: float


class _Parameter(_Shown):
    changes: int
    actual_mean: float = 0.0
    changes_at: list[Point] = []
    title: str = ""
    unit: str = ""
    shown: _Shown | None = None


class _Entry(_Keys):
    name: str
    entered_s: float
    inside_m: float


class _Endurance(_Keys):
    parameters: dict[str, float]
    computing_w: float
    power_w: float
    time_s: float | None


class _Endurances(_Keys):
    motion_w: float
    lowest: _Endurance
    flown: _Endurance
    highest: _Endurance
    gain_min_per_h: float | None


class _Solver(_Keys):
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
    median_ms: Annotated[float | None, Field(description="On standard output; a folder has it in timings.json.")] = None
    max_ms: Annotated[float | None, Field(description="As median_ms.")] = None


class _Segments(_Keys):
    segments: list[float]


class _Risk(_Keys):
    name: str
    probability: float


class _StageForecast(_Keys):
    stage: int
    time_s: float
    energy_wh: float


class _Cruise(_Keys):
    airspeed_mps: float
    completes_probability: float | None
    time_s: float | None
    soc_end: float | None
    quality: float | None


class _Forecast(_Keys):
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
    parameters: dict[str, float | _Segments]
    quality: float | None
    turn_back_s: float | None
    turn_back_m: Point | None
    batteries: int | None
    reach_share: float | None
    reach_s: float | None
    reach_m: Point | None
    obstacles: list[_Risk]
    stages: list[_StageForecast]
    autopilot: str = ""
    airspeeds_mps: list[float] = []
    at_cruise: _Cruise | None = None


class _Summary(_Keys):
    schema_: Literal["eadp.flight/1"] = Field(alias="schema")
    completed: bool
    reserve_kept: bool
    turned_back_s: float | None
    turned_back_m: Point | None
    reason: str
    battery_limit: str | None
    planner: str
    field: _FieldKeys | None
    duration_s: float
    distance_m: float
    energy_wh: float
    power_w: _Power
    soc_final: float
    soc_reserve: float
    period_s: float | None
    lap_times_s: list[float]
    parameters: dict[str, _Parameter]
    quality: float | None
    coverage: float | None
    obstacles: list[_Entry]
    paper_metric: float | None
    endurance: _Endurances | None
    decisions: int
    replans: int
    solver: _Solver
    energy_forecast: _Forecast | None
    never_past: str | None
    seed: int


def summary() -> dict[str, Any]:
    """JSON Schema of `summary.json`."""
    return _Summary.model_json_schema() | {"title": "eadp.flight/1"}


def decisions() -> dict[str, Any]:
    """JSON Schema of a line of `decisions.jsonl`."""
    keys = get_type_hints(DecisionRecord) | get_type_hints(Ending) | {"parameters": dict[str, float]}
    del keys["ending"]
    fields: dict[str, Any] = {key: (kind, ...) for key, kind in keys.items()}
    schema: dict[str, Any] = create_model("Decision", __config__=_STRICT, **fields).model_json_schema()
    return schema | {"title": "eadp.decisions/1"}
