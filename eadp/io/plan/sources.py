"""Texts as plans: of the plan language, or of another source, as missions of other software."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from eadp.core.arrays import FloatArray
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, refuse_others
from eadp.models.battery import Battery
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.plan import Finding, Plan, Site
from eadp.models.vehicle import Airframe, FixedWing
from eadp.plug_ins import plug_ins

_STAGES = re.compile(r"^[^\S\n]*path\s*:|^[^;\n]*;[^;\n]*;[^;\n]*[xy]", re.MULTILINE)
"""What a text of the plan language has: a section of stages, or a stage."""


Ground = Callable[[FloatArray, tuple[float, float]], FloatArray]
"""Heights above the sea, shape (n,) [m], at points, shape (n, 2) [m], round an origin [°]; raises InputError."""


@dataclass(frozen=True)
class PlanReader:
    """Reads a plan, or a text of another source as a plan: called with a text, returns the plan and warnings.

    It knows how an aircraft flies what has corners only.

    Attributes
    ----------
    turn_radius_m, airspeed_mps, climb_rate_mps, descent_rate_mps : float
        Radius of its turns [m], airspeed [m/s] and greatest rates of climb and descent [m/s].
    repeated_m : float
        Distance after which a mission that repeats for ever goes on, if no number of laps is given [m].
    laps : int or None
        How many times it is flown.
    ground : function, optional
        The ground, above which altitudes may be.
    calibrated : float
        Calibrated over true airspeed, where home has no height.
    """

    turn_radius_m: float = FixedWing().turn_radius_m
    airspeed_mps: float = FixedWing.airspeed_mps
    climb_rate_mps: float = FixedWing().climb_rates_mps(FixedWing.airspeed_mps)[0]
    descent_rate_mps: float = FixedWing().climb_rates_mps(FixedWing.airspeed_mps)[1]
    repeated_m: float = 100_000.0
    laps: int | None = None
    ground: Ground | None = None
    calibrated: float = 1.0

    @classmethod
    def of(cls, airframe: Airframe, battery: Battery) -> PlanReader:
        """The reader for an aircraft: what repeats for ever is longer than the battery lasts."""
        wing = airframe if airframe.takes_commands else FixedWing()
        rates_mps = wing.climb_rates_mps(wing.airspeed_mps)
        endurance_s = battery.endurance_s(airframe.cruise_power_w)
        repeated_m = min(1.25 * endurance_s * airframe.airspeed_mps, 1e6)
        calibrated = calibrated_over_true(Site(), airframe)
        return cls(airframe.turn_radius_m, airframe.airspeed_mps, *rates_mps, repeated_m, calibrated=calibrated)

    def __call__(self, text: Text) -> tuple[Plan, list[Finding]]:
        """Read a text.

        Raises
        ------
        InputError
            With every fault of the file.
        """
        source = _source_of(text)
        if source is None:
            refuse_others(text)
            return read_plan(text)
        return source.read(text, self)


class PlanSource(Protocol):
    """A source of plans besides the plan language."""

    def recognises(self, text: Text) -> bool:
        """Whether a text is of this source."""

    def read(self, text: Text, reader: PlanReader) -> tuple[Plan, list[Finding]]:
        """A text as a plan, and warnings; raises InputError."""


def is_mission(text: Text) -> bool:
    """Whether a text is of another source than the plan language."""
    return _source_of(text) is not None


def _source_of(text: Text) -> PlanSource | None:
    """The source of a text; None for the plan language, by which no source is imported."""
    if _STAGES.search(text.body) and not text.body.lstrip().startswith("{"):
        return None
    found: PlanSource | None = next((each for each in plug_ins("plan_sources") if each.recognises(text)), None)
    return found
