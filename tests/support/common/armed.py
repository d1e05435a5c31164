"""What autopilots ask of a mission before they arm, by their own rules and without eadp: PX4's checks of a plan.

Source: PX4's `FeasibilityChecker.cpp`: distances on a sphere, an approach from a circle along its tangent.
"""

import json
import math
from pathlib import Path

EARTH_M = 6371000.0
SUPPORTED = {16, 17, 19, 20, 21, 22, 31, 84, 85, 93, 4501, 177, 178, 179, 183, 189, 2003, 203, 2000, 2001, 2500, 2501,
             200, 204, 205, 1000, 1001, 201, 195, 196, 197, 206, 260, 214, 530, 531, 532, 3000}  # fmt: skip
POSITIONED = {16, 17, 19, 21, 22, 31, 84, 85}


def distance_m(a: list[float], b: list[float]) -> float:
    """The great circle between two places, as PX4 has it [m]."""
    (lat1, lon1), (lat2, lon2) = (map(math.radians, place) for place in (a, b))
    h = math.sin((lat2 - lat1) / 2) ** 2 + math.cos(lat1) * math.cos(lat2) * math.sin((lon2 - lon1) / 2) ** 2
    return 2 * EARTH_M * math.asin(math.sqrt(h))


def px4_refuses(path: Path, angle_deg: float = 5.0, required: int = 2) -> list[str]:
    """Why PX4 does not arm the mission of a plan, with its FW_LND_ANG and MIS_TKO_LAND_REQ; empty where it does."""
    items = json.loads(path.read_text())["mission"]["items"]
    found = [f"command {item['command']}" for item in items if item["command"] not in SUPPORTED]
    commands = [item["command"] for item in items]
    placed = [i for i, command in enumerate(commands) if command in POSITIONED]
    if commands.count(22) and commands.index(22) != placed[0]:
        found.append("takeoff not first")
    for i in (i for i, command in enumerate(commands) if command == 21):
        before, land = items[i - 1], items[i]
        if before["command"] not in (16, 31):
            found.append("approach entrance")
            continue
        way_m = distance_m(before["params"][4:6], land["params"][4:6])
        radius_m = abs(before["params"][1]) if before["command"] == 31 else 0.0
        down_m = before["params"][6] - land["params"][6]
        if way_m <= radius_m:
            found.append("inside orbit")
        elif down_m <= 0 or down_m / math.sqrt(way_m**2 - radius_m**2) > math.tan(math.radians(angle_deg + 0.1)):
            found.append(f"slope of {math.degrees(math.atan2(down_m, math.sqrt(way_m**2 - radius_m**2))):.1f}°")
    if commands.count(189) > 1 or (
        189 in commands and (21 not in commands or commands.index(189) > commands.index(21))
    ):
        found.append("land start")
    if 189 in commands and 20 in commands[commands.index(189) :]:
        found.append("land start before RTL")
    lands, takes_off = bool({21, 85} & set(commands)), 22 in commands
    if not {0: True, 1: takes_off, 2: lands, 3: lands and takes_off, 4: lands == takes_off}[required]:
        found.append("ends required")
    return found
