"""Decisions as JSON lines: the output of `eadp replan`."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from eadp.live.flight import Advice


class DecisionLine(BaseModel):
    """A line of decisions; null where unknown."""

    model_config = ConfigDict(strict=True, frozen=True)

    time_s: float = Field(description="of the telemetry line [s]")
    stage: int = Field(description="stage being flown, from 1")
    lap: int = Field(description="lap being flown, from 0")
    parameters: dict[str, float] = Field(description="decided, by name; path parameters wait for their stage")
    in_force: dict[str, float] = Field(description="in force now")
    soc_end_forecast: float | None = Field(
        description="state of charge at the end of the plan; negative by the shortfall of charge"
    )
    soc_end_std: float | None = Field(description="its standard deviation")
    completes_probability: float | None = Field(
        description="probability that the battery is not empty before the end, and the autopilot does not turn back"
    )
    reserve_probability: float | None = Field(
        description="probability that the reserve is kept; both with the least computations, or those that stay"
    )
    remaining_s: float | None = Field(description="time to the end of the plan [s]")
    energy_wh: float | None = Field(description="energy to the end of the plan [Wh]")
    energy_std_wh: float | None = Field(description="its standard deviation [Wh]")
    wind_mps: list[float] | None = Field(description="[x, y]: estimated wind, the vector that it blows towards [m/s]")
    reason: str = Field(description="the decision and its reason")
    warnings: list[str] = Field(description="codes of what is wrong with the telemetry")
    returns_home: bool = Field(description="whether to give the plan up and fly home, where the scenario allows it")
    home_reachable: bool | None = Field(description="whether home can be reached with the reserve kept")
    point_of_no_return_s: float | None = Field(
        description="up to when it can, as planned; or, if it cannot, when it could last: a time as time_s [s]"
    )
    home_by_s: float | None = Field(description="when home is reached at the latest: a time as time_s [s]")
    airspeed_mps: float | None = Field(description="true airspeed decided for this stage [m/s]")


def decision_line(advice: Advice) -> dict[str, Any]:
    """Advice as the object of a line."""
    fields = {**advice._asdict(), **advice.ending._asdict(), "soc_end_forecast": advice.ending.soc_end}
    fields["wind_mps"] = None if advice.wind_mps is None else list(advice.wind_mps)
    fields["warnings"] = list(advice.warnings)
    return {key: fields[key] for key in DecisionLine.model_fields}


def json_line(line: dict[str, Any]) -> str:
    """An object as one line of JSON, its end included; NaN and infinities are refused, as JSON has none.

    It is ASCII, so that it can be written in any encoding of the terminal.
    """
    return json.dumps(line, allow_nan=False) + "\n"
