"""What packages of others build on: these names and their public attributes are promised, see docs/library.md.

| an entry point of | is |
|---|---|
| `eadp.planners` | a subclass of `Planner`: `update` takes a `FlightState` and returns a `Decision` |
| `eadp.airframes` | a dataclass that inherits from `FixedWing` or `PowerCurve` |
| `eadp.batteries` | a `CellVoltage` |

A reader of logs builds on the room that reads them: `LogFormat` and `LogSource` of `eadp.measure.formats`, `PowerLog`
and `Columns` of `eadp.measure.power_log`, promised alike.

A planner asks `HeldForecast` how the rest of the flight ends with parameters held.
"""

from collections.abc import Callable

from eadp.core.arrays import FloatArray
from eadp.errors import EadpError, InputError
from eadp.models.vehicle import Airframe, FixedWing, PowerCurve
from eadp.models.world import Mission
from eadp.planning.base import Decision, Ending, Observation, PlannerSettings
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.registry import Planner
from eadp.planning.state.flight_state import FlightState

CellVoltage = Callable[[FloatArray], FloatArray]
"""Open-circuit voltage of a cell [V] of its states of charge, 0 to 1."""

__all__ = [
    "Airframe",
    "CellVoltage",
    "Decision",
    "EadpError",
    "Ending",
    "FixedWing",
    "FlightState",
    "HeldForecast",
    "InputError",
    "Mission",
    "Observation",
    "Planner",
    "PlannerSettings",
    "PowerCurve",
]
