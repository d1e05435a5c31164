from eadp.api.cover import CoverageOptions, CoveragePlan, cover
from eadp.api.export import ExportOptions, export
from eadp.api.fit.power import fit_power
from eadp.api.fit.vehicle import fit_vehicle
from eadp.api.flight import Flight
from eadp.api.given import FlightOptions
from eadp.api.plan import check_plan, read_mission, read_plan
from eadp.api.profile import read_profile
from eadp.api.replan.link import LinkOptions
from eadp.api.replan.replan import ReplanOptions, replan
from eadp.api.report import report
from eadp.api.simulate import forecast, simulate
from eadp.api.sorties.cover import cover_in_sorties
from eadp.api.sorties.job import JobFlight, simulate_sorties
from eadp.api.sorties.plan import SortieOptions, SortiePlan
from eadp.api.sweep.run import sweep
from eadp.api.vehicle import vehicle
from eadp.errors import EadpError, Infeasible, InputError
from eadp.io.sweep.statistics import SweepFlight
from eadp.models.energy import EnergyModel
from eadp.models.energy_fit import EnergyFit
from eadp.models.plan.plan import Plan
from eadp.models.profile import Profile
from eadp.models.profile_sum import ProfileSum

__version__: str
__all__ = [
    "CoverageOptions",
    "CoveragePlan",
    "EadpError",
    "EnergyFit",
    "EnergyModel",
    "ExportOptions",
    "Flight",
    "FlightOptions",
    "Infeasible",
    "InputError",
    "JobFlight",
    "LinkOptions",
    "Plan",
    "Profile",
    "ProfileSum",
    "ReplanOptions",
    "SortieOptions",
    "SortiePlan",
    "SweepFlight",
    "check_plan",
    "cover",
    "cover_in_sorties",
    "export",
    "fit_power",
    "fit_vehicle",
    "forecast",
    "read_mission",
    "read_plan",
    "read_profile",
    "replan",
    "report",
    "simulate",
    "simulate_sorties",
    "sweep",
    "vehicle",
]
