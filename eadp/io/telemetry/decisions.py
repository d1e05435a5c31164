"""Decisions as JSON lines: what `eadp replan` answers."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from eadp.planning.live import Advice


class DecisionLine(BaseModel):
    """A line of decisions; null is what is not known."""

    model_config = ConfigDict(strict=True, frozen=True)

    time_s: float = Field(description="of the telemetry line that it answers [s]")
    stage: int = Field(description="the plan's stage that is flown, from 1")
    lap: int = Field(description="the lap that is flown, from 0")
    parameters: dict[str, float] = Field(description="to fly with, by name; path parameters wait for their stage")
    in_force: dict[str, float] = Field(description="those that the plan has put into force by now")
    soc_end_forecast: float | None = Field(
        description="state of charge at the end of the plan; below 0, by how much the battery is short"
    )
    completes_probability: float | None = Field(description="that the battery is not empty before the end")
    reserve_probability: float | None = Field(description="that the reserve is kept")
    remaining_s: float | None = Field(description="to the end of the plan [s]")
    wind_mps: list[float] | None = Field(description="[x, y]: where the wind blows towards, as estimated [m/s]")
    reason: str = Field(description="what has been decided and why")


def json_schema() -> dict[str, Any]:
    """JSON Schema of a line of decisions."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **DecisionLine.model_json_schema()}


def decision_line(advice: Advice) -> dict[str, Any]:
    """Advice as the object of a line."""
    line = advice._asdict()
    line["wind_mps"] = None if advice.wind_mps is None else list(advice.wind_mps)
    return line


def json_line(line: dict[str, Any]) -> str:
    """An object as one line of JSON, its end included; NaN and infinities are refused, as JSON has none.

    It is ASCII: whatever the terminal's encoding, an answer must not fail to be told.
    """
    return json.dumps(line, allow_nan=False) + "\n"
