from eadp.api.flight import Flight, forecast, simulate
from eadp.api.given import FlightOptions
from eadp.api.plan import check_plan, read_plan
from eadp.api.vehicle import read_profile, vehicle
from eadp.errors import EadpError, Infeasible, InputError
from eadp.exchange.export import ExportOptions, export
from eadp.live.link import LinkOptions
from eadp.live.replan import ReplanOptions, replan
from eadp.measure.power import EnergyFit, fit_power
from eadp.measure.vehicle import fit_vehicle
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Plan
from eadp.models.profile import Profile
from eadp.report.report import report
from eadp.survey.cover import cover
from eadp.survey.folder import JobFlight, simulate_sorties
from eadp.survey.options import CoverageOptions
from eadp.survey.report import CoveragePlan
from eadp.survey.resume import cover_in_sorties
from eadp.survey.sorties import SortieOptions, SortiePlan
from eadp.sweep.results import SweepFlight
from eadp.sweep.run import sweep

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
    "read_plan",
    "read_profile",
    "replan",
    "report",
    "simulate",
    "simulate_sorties",
    "sweep",
    "vehicle",
]
