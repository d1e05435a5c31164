"""eadp: energy-aware dynamic planning of a fixed-wing robot's flight and of its onboard computing.

The public names are imported when they are first used: `import eadp` alone imports no other library. Their types stand
in `__init__.pyi`.
"""

import importlib
from types import FunctionType
from typing import Any

__version__ = "0.1.0"

_MODULES = {
    "eadp.api.cover": ("CoverageOptions", "CoveragePlan", "cover"),
    "eadp.api.export": ("ExportOptions", "export"),
    "eadp.api.fit.power": ("fit_power",),
    "eadp.api.fit.vehicle": ("fit_vehicle",),
    "eadp.api.flight": ("Flight",),
    "eadp.api.given": ("FlightOptions",),
    "eadp.api.plan": ("check_plan", "read_mission", "read_plan"),
    "eadp.api.profile": ("read_profile",),
    "eadp.api.replan.link": ("LinkOptions",),
    "eadp.api.replan.replan": ("ReplanOptions", "replan"),
    "eadp.api.report": ("report",),
    "eadp.api.simulate": ("forecast", "simulate"),
    "eadp.api.sorties.job": ("JobFlight", "simulate_sorties"),
    "eadp.api.sorties.cover": ("cover_in_sorties",),
    "eadp.api.sorties.plan": ("SortieOptions", "SortiePlan"),
    "eadp.api.sweep.run": ("sweep",),
    "eadp.api.vehicle": ("vehicle",),
    "eadp.errors": ("EadpError", "Infeasible", "InputError"),
    "eadp.models.energy": ("EnergyModel",),
    "eadp.models.energy_fit": ("EnergyFit",),
    "eadp.models.plan.plan": ("Plan",),
    "eadp.models.profile": ("Profile",),
    "eadp.models.profile_sum": ("ProfileSum",),
    "eadp.io.sweep.statistics": ("SweepFlight",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_MODULE_OF[name]), name)
    if isinstance(found, FunctionType):
        found = importlib.import_module("eadp.api.public").public(found)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
