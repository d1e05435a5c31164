"""The autopilot that flies a plan, for its own rules: when it turns back, how it returns, which landing it accepts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

ARDUPILOT, PX4 = "ardupilot", "px4"

FACTORY: Mapping[str, Mapping[str, float]] = {
    ARDUPILOT: {},
    PX4: {"FW_LND_ANG": 5.0, "MIS_TKO_LAND_REQ": 2.0},
}
"""Values of parameters of a fixed wing that an owner has not changed, by kind.

Source: ardupilot.org, "Complete Parameter List" of Plane; docs.px4.io, "Parameter Reference", and `rc.fw_defaults`.
"""


@dataclass(frozen=True)
class Autopilot:
    """The autopilot and its parameters, which `eadp replan --mavlink` reads from it."""

    kind: Literal["ardupilot", "px4"] | None = None
    """Its software: ardupilot or px4; by default none, whose rules do not count."""

    parameters: Mapping[str, float] = field(default_factory=dict)
    """Its parameters by name, where they are not the factory's, like FW_LND_ANG: 7."""

    def value(self, name: str) -> float | None:
        """A parameter's value: as given, else the factory's of its kind; None where neither has it."""
        return self.parameters.get(name, FACTORY.get(self.kind or "", {}).get(name))
