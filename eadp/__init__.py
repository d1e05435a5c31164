"""eadp: energy-aware dynamic planning of a fixed-wing robot's flight and of its onboard computing.

The public names are imported when they are first used: `import eadp` alone imports no other library. Their types stand
in `__init__.pyi`.
"""

import importlib
from typing import Any

__version__ = "0.1.0"

_MODULES = {
    "eadp.api": (
        "cover",
        "cover_in_sorties",
        "export",
        "fit_power",
        "fit_vehicle",
        "forecast",
        "read_mission",
        "read_plan",
        "read_profile",
        "report",
        "simulate",
        "simulate_sorties",
        "sweep",
        "vehicle",
    ),
    "eadp.errors": ("EadpError", "Infeasible", "InputError"),
    "eadp.io.field.coverage": ("CoverageOptions", "CoveragePlan"),
    "eadp.io.flight.export": ("ExportOptions",),
    "eadp.io.flight.folder": ("Flight",),
    "eadp.io.sorties.job": ("JobFlight",),
    "eadp.io.sorties.plan": ("SortieOptions", "SortiePlan"),
    "eadp.models.energy": ("EnergyModel",),
    "eadp.models.energy_fit": ("EnergyFit",),
    "eadp.models.plan.plan": ("Plan",),
    "eadp.models.profile": ("Profile",),
    "eadp.models.profile_sum": ("ProfileSum",),
    "eadp.simulation.sweep.statistics": ("SweepFlight",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
