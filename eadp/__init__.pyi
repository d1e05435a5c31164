from eadp.api import (
    cover,
    export,
    fit_power,
    fit_vehicle,
    forecast,
    read_mission,
    read_plan,
    read_profile,
    report,
    simulate,
    sweep,
    vehicle,
)
from eadp.errors import EadpError, Infeasible, InputError
from eadp.io.field.coverage import CoverageOptions, CoveragePlan
from eadp.io.flight.export import ExportOptions
from eadp.io.flight.folder import Flight
from eadp.models.energy import EnergyModel
from eadp.models.energy_fit import EnergyFit
from eadp.models.plan.plan import Plan
from eadp.models.profile import Profile
from eadp.models.profile_sum import ProfileSum
from eadp.simulation.sweep.statistics import SweepFlight

__version__: str
__all__ = [
    "CoverageOptions",
    "CoveragePlan",
    "EadpError",
    "EnergyFit",
    "EnergyModel",
    "ExportOptions",
    "Flight",
    "Infeasible",
    "InputError",
    "Plan",
    "Profile",
    "ProfileSum",
    "SweepFlight",
    "cover",
    "export",
    "fit_power",
    "fit_vehicle",
    "forecast",
    "read_mission",
    "read_plan",
    "read_profile",
    "report",
    "simulate",
    "sweep",
    "vehicle",
]
