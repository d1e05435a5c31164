"""The rest of a mission as new items, after those that stay."""

from __future__ import annotations

from collections.abc import Sequence

from eadp.io.mission import draft as d
from eadp.io.mission.draft import MissionItem
from eadp.io.mission.export import mission_items
from eadp.io.mission.items import MappedItem, mapped_items
from eadp.io.mission.path import PlannedPath, planned_sections
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs


class RestLayout:
    """Lays out what is left of a plan as items.

    Parameters
    ----------
    plan : Plan
    airspeed_mps, calibrated : float
        Of the aircraft [m/s], and the airspeed that an autopilot holds over it.
    """

    def __init__(self, plan: Plan, airspeed_mps: float, calibrated: float = 1.0) -> None:
        self._plan, self._airspeed_mps, self._calibrated = plan, airspeed_mps, calibrated

    def altitude_fault(self, held: Sequence[MissionItem]) -> str | None:
        """Why new items cannot have the altitudes of the items held, None where they can.

        New items are above home, all at one altitude, but where the plan's stages have altitudes of their own. That up
        to which a take-off climbs is none of the plan.
        """
        if any(item.placed and d.GLOBAL_FRAMES[item.frame] != d.RELATIVE for item in held):
            return "altitudes of the mission are not above home"
        at_one_altitude = all(stage.altitude_m is None for stage in self._plan.stages)
        if at_one_altitude and len({round(altitude_m, 1) for altitude_m in _altitudes_m(held)}) > 1:
            return "altitudes of the mission are not those of the plan"
        return None

    def after(
        self, held: Sequence[MissionItem], mapped: Sequence[MappedItem], planned: PlannedLegs, *, px4: bool
    ) -> tuple[int, list[MappedItem]]:
        """The number of items held that stay, the first ones, and the new items that follow them.

        Parameters
        ----------
        held, mapped : sequence
            The items that are held, home aside, and the stages of each; in order.
        planned : PlannedLegs
            What is left to fly, from the stage being flown on.
        px4 : bool
            Whether turns are waypoints, see `mission_items`.

        Raises
        ------
        PathUndefined
            If it cannot be laid out.
        """
        # stages count from 1; `started` is the one being flown; `mapped` is in order, so that the count is a prefix
        kept = sum(each.first <= planned.started for each in mapped)
        # new items follow the last stage that an item that stays leads along: `left` is without its leg, too
        last_stage = max([planned.started, *(each.last for each in mapped[:kept])])
        left = planned.after(last_stage - planned.started + 1)
        if not any(leg.distance_m > 0 for leg in left.legs):
            return kept, []
        site = self._plan.site
        assert site.origin_deg is not None
        path = PlannedPath(
            name="the rest",
            sections=planned_sections(left.legs),
            origin_deg=site.origin_deg,
            altitude_m=(_altitudes_m(held[:kept]) or _altitudes_m(held)[::-1] or [held[0].altitude_m])[-1],
            airspeed_mps=self._airspeed_mps,
            home_deg=site.origin_deg if held[-1].command == d.RETURN else None,
            trigger_distance_m=self._trigger_distance_m(held),
            airspace=site.airspace,
            calibrated=self._calibrated,
        )
        return kept, mapped_items(mission_items(path, flying=True, px4=px4), left, self._plan.path_count)

    def _trigger_distance_m(self, held: Sequence[MissionItem]) -> float | None:
        """Distance between pictures, for a mission that takes them all the way [m]; None without, or where stages have
        commands for it."""
        if any(command[0] == d.TRIGGER_DISTANCE for stage in self._plan.stages for command in stage.commands):
            return None
        distances = (item.parameters[0] for item in held if item.command == d.TRIGGER_DISTANCE)
        return next((distance_m for distance_m in distances if distance_m > 0), None)


def _altitudes_m(items: Sequence[MissionItem]) -> list[float]:
    """Altitudes of the items with a position [m], without the take-off's."""
    return [item.altitude_m for item in items if item.placed and item.command != d.TAKEOFF]
