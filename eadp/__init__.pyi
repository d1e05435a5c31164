from eadp.api import (
    cover,
    cover_in_sorties,
    export,
    fit_power,
    fit_vehicle,
    forecast,
    read_mission,
    read_plan,
    read_profile,
    report,
    simulate,
    simulate_sorties,
    sweep,
    vehicle,
)
from eadp.errors import EadpError, Infeasible, InputError
from eadp.io.field.coverage import CoverageOptions, CoveragePlan
from eadp.io.flight.export import ExportOptions
from eadp.io.flight.folder import Flight
from eadp.io.sorties.job import JobFlight
from eadp.io.sorties.plan import SortieOptions, SortiePlan
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
    "JobFlight",
    "Plan",
    "Profile",
    "ProfileSum",
    "SortieOptions",
    "SortiePlan",
    "SweepFlight",
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
]
