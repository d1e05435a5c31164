"""eadp: energy-aware dynamic planning of a fixed-wing robot's flight and of its onboard computing.

The public names are imported when they are first used: `import eadp` alone imports no other library. Their types stand
in `__init__.pyi`.
"""

import importlib
import sys
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

_MODULES = {
    "eadp.survey.cover": ("cover",),
    "eadp.survey.options": ("CoverageOptions",),
    "eadp.survey.report": ("CoveragePlan",),
    "eadp.exchange.export": ("ExportOptions", "export"),
    "eadp.measure.power": ("EnergyFit", "fit_power"),
    "eadp.measure.vehicle": ("fit_vehicle",),
    "eadp.api.flight": ("Flight", "forecast", "simulate"),
    "eadp.api.given": ("FlightOptions",),
    "eadp.api.plan": ("check_plan", "read_plan"),
    "eadp.live.link": ("LinkOptions",),
    "eadp.live.replan": ("ReplanOptions", "replan"),
    "eadp.report.report": ("report",),
    "eadp.survey.folder": ("JobFlight", "simulate_sorties"),
    "eadp.survey.resume": ("cover_in_sorties",),
    "eadp.survey.sorties": ("SortieOptions", "SortiePlan"),
    "eadp.sweep.run": ("sweep",),
    "eadp.api.vehicle": ("read_profile", "vehicle"),
    "eadp.errors": ("EadpError", "Infeasible", "InputError"),
    "eadp.models.energy": ("EnergyModel",),
    "eadp.models.plan.plan": ("Plan",),
    "eadp.models.profile": ("Profile",),
    "eadp.sweep.results": ("SweepFlight",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Package(ModuleType):
    """The package: a public name stays what it is where a package below has it, too, as `sweep` and `report`."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _MODULE_OF or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
