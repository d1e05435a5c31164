"""What flies a plan: the profile of the computations, and what an aircraft can do."""

from __future__ import annotations

from collections.abc import Sequence

from eadp.api.given import File, Warn, python_warnings
from eadp.io.profile.model_file import parse_profile
from eadp.io.text.streams import read_text
from eadp.io.vehicle import VehicleFile, read_vehicle
from eadp.models.performance import Performance, performance
from eadp.models.profile import Profile


def read_profile(file: File, *, warn: Warn = python_warnings) -> Profile:
    """Read a computation profile.

    Parameters
    ----------
    file : str or path
        Measurements (CSV) or a model (YAML), `-` for standard input.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the file.
    """
    profile, found = parse_profile(read_text(str(file)))
    warn(found)
    return profile


def vehicle(
    file: File, winds_mps: Sequence[float] = (0.0, 5.0, 8.0), *, computing_w: float = 0.0, reserve_soc: float = 0.05
) -> tuple[VehicleFile, Performance]:
    """What an aircraft can do: stall, best speeds, level power, turning radius, endurance and range in wind.

    Parameters
    ----------
    file : path
        Vehicle file.
    winds_mps : sequence of float
        Speeds of the wind, for endurance and range [m/s].
    computing_w : float
        Power of the computations, beside the motion's [W].
    reserve_soc : float
        State of charge to keep.

    Returns
    -------
    (VehicleFile, Performance)
        The aircraft, and what it can do; `faults` says why it cannot fly as described, if it cannot.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    found = read_vehicle(read_text(str(file)))
    return found, performance(
        found.airframe, found.battery, winds_mps, computing_w=computing_w, reserve_soc=reserve_soc
    )
