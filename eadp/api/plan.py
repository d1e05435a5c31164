"""Reading plans, and missions of other software as plans."""

from __future__ import annotations

from eadp.api.given import File, Warn, python_warnings
from eadp.errors import InputError
from eadp.io.mission.reader import PlanReader, is_mission
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.plan import Plan


def read_plan(
    file: File, *, min_radius_m: float | None = None, laps: int | None = None, warn: Warn = python_warnings
) -> Plan:
    """Read a plan, or a mission of other software.

    Parameters
    ----------
    file : str or path
        The file, `-` for standard input.
    min_radius_m : float, optional
        Radius of a mission's turns [m]; by default the default aircraft's.
    laps : int, optional
        How many times a mission that repeats for ever is flown.
    warn : function, optional

    Raises
    ------
    InputError
        With every fault of the file.
    """
    return _read_plan(read_text(str(file)), min_radius_m, laps, warn)


def read_mission(
    file: File, *, min_radius_m: float | None = None, laps: int | None = None, warn: Warn = python_warnings
) -> Plan:
    """Read a mission of other software as a plan: as `read_plan`, which also reads plans.

    Raises
    ------
    InputError
        With every fault of the file; where it is a plan of eadp, too.
    """
    text = read_text(str(file))
    if not is_mission(text):
        raise InputError.at(text.name, 1, 1, "is no mission", "a QGroundControl plan or a WPL file")
    return _read_plan(text, min_radius_m, laps, warn)


def _read_plan(text: Text, min_radius_m: float | None, laps: int | None, warn: Warn) -> Plan:
    plan, findings = PlanReader(laps=laps).turning(min_radius_m)(text)
    warn([finding.fault(text.name) for finding in findings])
    return plan
