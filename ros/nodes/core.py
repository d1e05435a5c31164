"""A flight that is re-planned by what ROS says, without ROS: messages in, decisions and the detectors' rates out.

Messages of ROS 1 and ROS 2 have the same fields, but for the two halves of a stamp.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any

from eadp import InputError
from eadp.api.inputs import load_flight
from eadp.exchange.items import MissionItem
from eadp.exchange.writer import read_items
from eadp.live.link import LinkFlight, LinkOptions
from eadp.live.messages import ACTIVE, IN_AIR, finite
from eadp.live.replanner import ReplanLog, hash_of

MISSION_MODES = {"AUTO": "ardupilot", "AUTO.MISSION": "px4"}
RETURN_MODES, GUIDED_MODES = ("RTL", "SMART_RTL", "QRTL", "AUTO.RTL"), ("GUIDED", "OFFBOARD")
"""Modes of MAVROS in which an autopilot of a kind flies its mission; in which one flies home, or a computer flies."""


class Core:
    """The planner on messages of MAVROS; each takes effect when it comes, and a fix makes a decision where one is due.

    Parameters
    ----------
    given : dict of str to str
        The files `plan` and `scenario`, and, if there are any, `items` of the mission and a `log`.
    decided : function (JSON text)
        Takes each decision, as `eadp replan` prints it.
    rate : function (name, value)
        Takes each computation's value with each decision, by its name in topics.
    warn : function (text)

    Attributes
    ----------
    topics : dict of str to (module of the message's type, its name, the method that takes it)

    Raises
    ------
    InputError
        With the faults of the files.
    """

    def __init__(
        self,
        given: dict[str, str],
        decided: Callable[[str], None],
        rate: Callable[[str, float], None],
        warn: Callable[[str], None],
    ) -> None:
        inputs, items = load_flight(given["plan"], scenario=given["scenario"]), given.get("items") or None
        plan = inputs.mission.plan
        self._items = None if items is None else read_items(items, plan.names[: plan.path_count])
        of_plan = plan.parameters[plan.path_count :]
        self._computations = {each.label if each.label.isidentifier() else each.name: each for each in of_plan}
        self._decided, self._rate, self._lock = decided, rate, Lock()
        log = ReplanLog(given["log"], hash_of(inputs.sources, {})) if given.get("log") else None
        options = LinkOptions(items=items)
        self._flight = LinkFlight(inputs, "ROS", options, log, self._emit, lambda fault: warn(str(fault)))
        self._altitude_m: float | None = None
        self.topics: dict[str, tuple[str, str, Callable[[Any], None]]] = {
            "mavros/battery": ("sensor_msgs.msg", "BatteryState", self.battery),
            "mavros/global_position/global": ("sensor_msgs.msg", "NavSatFix", self.fix),
            "mavros/global_position/rel_alt": ("std_msgs.msg", "Float64", self.altitude),
            "mavros/state": ("mavros_msgs.msg", "State", self.state),
            "mavros/extended_state": ("mavros_msgs.msg", "ExtendedState", self.landed),
            "mavros/mission/waypoints": ("mavros_msgs.msg", "WaypointList", self.mission),
        } | {
            f"eadp/reached/{name}": ("std_msgs.msg", "Float64", partial(self.reached, each.name))
            for name, each in self._computations.items()
        }

    def battery(self, message: Any) -> None:
        """A BatteryState: its current is below 0 while it discharges; what is unknown is NaN, or a share below 0."""
        share = message.percentage if 0 <= message.percentage <= 1 else None
        self._take({"voltage_v": message.voltage or None, "current_a": -message.current, "remaining": share})

    def fix(self, message: Any) -> None:
        """A NavSatFix."""
        stamp = message.header.stamp
        ros1 = hasattr(stamp, "secs")
        values = {"time_s": stamp.secs + stamp.nsecs / 1e9 if ros1 else stamp.sec + stamp.nanosec / 1e9}
        if message.status.status >= 0:
            values |= {"lat_deg": message.latitude, "lon_deg": message.longitude, "altitude_m": self._altitude_m}
        self._take(values)

    def altitude(self, message: Any) -> None:
        """A Float64, the altitude above home [m]."""
        self._altitude_m = message.data

    def state(self, message: Any) -> None:
        """A State: whether the aircraft flies its mission, or home, or a computer flies it."""
        kind, mode = MISSION_MODES.get(message.mode), message.mode
        if not mode:  # no heartbeat yet
            return
        values = {"automatic": kind is not None, "returns": mode in RETURN_MODES, "guided": mode in GUIDED_MODES}
        values |= {"armed": message.armed, "active": message.system_status in ACTIVE}
        self._take(values | ({} if kind is None else {"kind": kind}))

    def landed(self, message: Any) -> None:
        """An ExtendedState: whether the aircraft is in the air, where the autopilot knows it."""
        self._take({"in_air": None if message.landed_state == 0 else message.landed_state in IN_AIR})

    def mission(self, message: Any) -> None:
        """A WaypointList: the items that the autopilot holds, ArduPilot's after home, and the one flown to."""
        if self._items is None:
            return
        items = [MissionItem(each.command, each.frame, _numbers(each)) for each in message.waypoints]
        home = len(items) - len(self._items) == 1
        with self._lock:
            self._flight.hold(items[home:])
        self._take({"home_is_item": home, "item": message.current_seq})

    def reached(self, name: str, message: Any) -> None:
        """A Float64, the value that a computation's process reaches."""
        self._take({"named": (name, message.data)})

    def _take(self, values: dict[str, Any]) -> None:
        with self._lock:  # rospy calls from a thread for each topic
            self._flight.update({key: finite(value) for key, value in values.items()})

    def _emit(self, line: dict[str, Any]) -> None:
        self._decided(json.dumps(line))
        for name, each in self._computations.items():
            self._rate(name, each.shown(line["parameters"][each.name]))


def _numbers(item: Any) -> tuple[float, ...]:
    return item.param1, item.param2, item.param3, item.param4, item.x_lat, item.y_long, item.z_alt


__all__ = ["Core", "InputError"]
