"""The use cases of eadp as functions: what `import eadp` shows, and what its commands call.

Files are given by their paths, or as objects that were read or made before. What a flight does not
need is imported when it is used. `warn` takes the warnings, a list of `Fault`; by default they become Python's own.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any

from eadp.errors import Fault, InputError
from eadp.io.flight.folder import Flight, fly_flight, forecast_values
from eadp.io.flight.inputs import Files, FlightInputs, load_flight
from eadp.io.mission.reader import PlanReader, is_mission
from eadp.io.plan import writer
from eadp.io.profile import model_file
from eadp.io.scenario.scenario_file import override_texts, read_overrides, read_scenario, value_text
from eadp.io.text.named import parse_named
from eadp.io.text.streams import Text, read_text
from eadp.io.vehicle.presets import read_vehicle
from eadp.models.energy import EnergyModel
from eadp.models.performance import too_tight
from eadp.models.plan.plan import Plan
from eadp.models.profile_sum import AnyProfile
from eadp.simulation.loop import Step

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eadp.io.field.coverage import CoverageOptions, CoveragePlan, CoverageTask
    from eadp.io.flight.export import ExportOptions
    from eadp.io.log.vehicle_fit import VehicleLogFit
    from eadp.io.sorties.job import JobFlight
    from eadp.io.sorties.plan import SortieOptions, SortiePlan
    from eadp.io.sweep.flights import SweepFlights
    from eadp.io.vehicle.vehicle_file import VehicleFile
    from eadp.models.energy_fit import EnergyFit
    from eadp.models.performance import Performance

File = str | PathLike[str]
Overrides = Mapping[str, Any] | Iterable[str]
Warn = Callable[[Sequence[Fault]], None]


def _python_warnings(faults: Sequence[Fault]) -> None:
    for fault in faults:
        warnings.warn(str(fault), stacklevel=3)


def read_plan(
    file: File, *, min_radius_m: float | None = None, laps: int | None = None, warn: Warn = _python_warnings
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
    file: File, *, min_radius_m: float | None = None, laps: int | None = None, warn: Warn = _python_warnings
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


def read_profile(file: File, *, warn: Warn = _python_warnings) -> AnyProfile:
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
    profile, found = model_file.read_profile(str(file))
    warn(found)
    return profile


def fit_power(
    times_s: ArrayLike,
    power_w: ArrayLike,
    period_prior_s: float | None = None,
    *,
    order: int | None = None,
    keep_spikes: bool = False,
) -> EnergyFit:
    """Fit the energy model of a power log: its period, mean, harmonics and noise.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        Strictly increasing times [s] and power [W].
    period_prior_s : float, optional
        The period is searched within a factor of 1.3 of this one [s].
    order : int, optional
        Number of harmonics, by default found by cross-validation.
    keep_spikes : bool, optional
        Whether single samples far from their neighbours are fitted, too.

    Returns
    -------
    EnergyFit
        Its `model.period_s` is None where no period is significant.

    Raises
    ------
    Infeasible
        If the samples are too few, not finite, or not in order.
    """
    from eadp.models.energy_fit import fit_energy

    return fit_energy(times_s, power_w, order=order, period_prior_s=period_prior_s, keep_spikes=keep_spikes)


def simulate(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | AnyProfile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    planner: str | None = None,
    seed: int | None = None,
    *,
    laps: int | None = None,
    on_step: Callable[[Step], None] = lambda _step: None,
    warn: Warn = _python_warnings,
) -> Flight:
    """Fly a plan in simulation, re-planning on the way.

    Parameters
    ----------
    plan : path or Plan
        A path may be that of a mission of other software.
    scenario : path or mapping, optional
        A scenario file, or its keys; by default the defaults.
    profile : path or profile, optional
        By default the scenario's.
    energy : path or EnergyModel, optional
    overrides : mapping, or iterable of str, optional
        Values by the scenario's dotted keys, as in {"wind.speed_mps": 8}, or texts, as in "wind.speed_mps=8".
    planner : str, optional
        Name of the planner, by default the scenario's.
    seed : int, optional
        Seed of gusts and noise, by default the scenario's.
    laps : int, optional
        How many times a mission that repeats for ever is flown, by default the scenario's.
    on_step : function, optional
        Called with each logged step, such as for a progress bar.
    warn : function, optional

    Returns
    -------
    Flight
        Its summary, columns and decisions; `write` writes the result folder.

    Raises
    ------
    InputError
        With every fault of the first file that has any.
    """
    inputs, texts = _load(plan, scenario, profile, energy, override_texts(overrides, planner, seed, laps))
    warn(inputs.warnings)
    return fly_flight(inputs, inputs.preflight(), on_step, texts)


def simulate_sorties(
    folder: File,
    overrides: Overrides = (),
    seed: int = 0,
    *,
    on_flight: Callable[[str], None] = lambda _name: None,
    warn: Warn = _python_warnings,
) -> JobFlight:
    """Fly all sorties of a folder in turn, each with a fresh pack, and then what they leave of the field.

    Parameters
    ----------
    folder : path
        Of `eadp cover --sorties`.
    overrides
        As for `simulate`, in every flight.
    seed : int, optional
        Of gusts, noise and late take-offs.
    on_flight : function, optional
        Called with the name of each flight before it.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the folder.
    """
    from eadp.io.sorties.job import fly_sorties

    return fly_sorties(str(folder), override_texts(overrides), seed, on_flight, warn)


def _load(plan: Any, scenario: Any, profile: Any, energy: Any, texts: list[str]) -> tuple[FlightInputs, list[str]]:
    """A flight's inputs, of paths or objects, with overrides as texts."""
    files = Files()
    inputs = load_flight(
        _path(plan, files.texts),
        scenario_path=None if scenario is None else _path(scenario, files.texts, "eadp.scenario/1"),
        profile_path=None if profile is None else _path(profile, files.texts),
        energy_path=None if energy is None else _path(energy, files.texts),
        overrides=read_overrides(texts),
        files=files,
    )
    return inputs, texts


def forecast(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | AnyProfile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    planner: str | None = None,
    *,
    laps: int | None = None,
    warn: Warn = _python_warnings,
) -> dict[str, Any] | None:
    """Forecast a flight before take-off, without flying it.

    Parameters
    ----------
    plan, scenario, profile, energy, overrides, planner, laps, warn
        As `simulate`.

    Returns
    -------
    dict or None
        The content of `energy_forecast` in `summary.json`: the probabilities to complete and to keep the reserve, time,
        energy, charge at the end, parameters. None where the charge is prescribed.

    Raises
    ------
    InputError
        As `simulate`.
    """
    inputs, _ = _load(plan, scenario, profile, energy, override_texts(overrides, planner, None, laps))
    warn(inputs.warnings)
    found = inputs.preflight()
    return None if found is None else forecast_values(found)


def export(
    plan: File | Plan,
    to: str,
    options: ExportOptions | None = None,
    out: File | None = None,
    *,
    warn: Warn = _python_warnings,
) -> str:
    """Write a plan as the mission of an autopilot, or as a map.

    Parameters
    ----------
    plan : path or Plan
    to : str
        Format: `qgc`, `ardupilot`, `paparazzi`, `geojson`, `kml` or `gpx`.
    options : ExportOptions, optional
        With a scenario the parameters are those that the forecast chooses.
    out : path, optional
        Write it here, too; beside the mission of an autopilot a file `.items.json`, which `eadp replan` reads.
    warn : function, optional
        Takes what was forecast, as a note, and what the format cannot hold.

    Returns
    -------
    str
        The text of the mission.

    Raises
    ------
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    from eadp.io.flight.export import ExportOptions, exported

    files = Files()
    mission = exported(_path(plan, files.texts), to, options or ExportOptions(), warn, files)
    if out is not None and str(out) != "-":
        mission.write(str(out))
    return mission.text


def vehicle(
    file: File,
    winds_mps: Sequence[float] = (0.0, 5.0, 8.0),
    *,
    computing_w: float = 0.0,
    reserve_soc: float = 0.05,
    warn: Warn = _python_warnings,
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
    warn : function, optional

    Returns
    -------
    (VehicleFile, Performance)
        The aircraft, and what it can do; `faults` says why it cannot fly as described, if it cannot.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    from eadp.io.text.schema_faults import keys_document
    from eadp.io.vehicle.vehicle_file import SCHEMA, vehicle_of, vehicle_warnings
    from eadp.models.performance import performance

    keys = keys_document(read_text(str(file)), SCHEMA)
    found = vehicle_of(keys)
    warn(vehicle_warnings(keys, found))
    return found, performance(
        found.airframe, found.battery, winds_mps, computing_w=computing_w, reserve_soc=reserve_soc
    )


def fit_vehicle(log: File, base: File | None = None, *, warn: Warn = _python_warnings) -> VehicleLogFit:
    """Fit an aircraft's power to a log with airspeed: level flight, its rise with bank, climb and airspeed.

    Parameters
    ----------
    log : path
        CSV with a header, PX4 ULog or ArduPilot DataFlash log.
    base : path, optional
        Vehicle file of what is known: mass, wing, avionics, for a drag polar.
    warn : function, optional

    Returns
    -------
    VehicleLogFit
        `yaml` is the vehicle file, `text` says how sure each value is.

    Raises
    ------
    InputError
        With the faults of a file, or with what the log lacks.
    """
    from eadp.io.log.power_log import Columns
    from eadp.io.log.vehicle_fit import read_vehicle_fit

    found = read_vehicle_fit(str(log), Columns(), "" if base is None else str(base))
    warn(found.warnings)
    return found


def report(result: File | Sequence[File], out: File | None = None, keep: File | None = None) -> str:
    """Write a result as one HTML page that needs no network.

    Parameters
    ----------
    result : path, or sequence of paths
        A result folder, the results file of a sweep, or a log of `eadp replan`. Several folders of flights are drawn
        beside each other.
    out : path, optional
        By default `report.html` in the folder, or beside the file under its name; `-` is standard output.
    keep : path, optional
        Where the folders of a sweep's flights are, for links to them.

    Returns
    -------
    str
        The page's path.

    Raises
    ------
    InputError
        If it is no result, is damaged, or the page cannot be written.
    """
    from eadp.io.report.result import write_comparison, write_report

    if not isinstance(result, str | PathLike):
        return write_comparison([*map(str, result)], None if out is None else str(out))[0]
    return write_report(str(result), *(None if each is None else str(each) for each in (out, keep)))


def cover(
    field: File,
    options: CoverageOptions,
    profile: File | AnyProfile | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
    warn: Warn = _python_warnings,
) -> CoveragePlan:
    """Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Parameters
    ----------
    field : path
        Outline: GeoJSON, KML or CSV of vertices.
    options : CoverageOptions
        The turning radius and the swath, and what else is prescribed.
    profile : path or profile, optional
        The plan gets its computations, and the report the energy; by default the scenario's.
    scenario : path, optional
        For the vehicle, the wind and the energy.
    vehicle : path, optional
        The aircraft, instead of the scenario's.
    warn : function, optional

    Raises
    ------
    Infeasible
        If no path of this pattern covers the field.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    from eadp.coverage.cover import cover as cover_field

    task = _coverage_task(str(field), options, profile, scenario, vehicle, warn)
    return task.planned(cover_field(task.request))


def _coverage_task(
    field: str,
    options: CoverageOptions,
    profile: File | AnyProfile | None,
    scenario: File | None,
    vehicle: File | None,
    warn: Warn,
) -> CoverageTask:
    """A field to cover, with the aircraft and the wind of a scenario; warns of turns that are too tight."""
    from eadp.io.field.coverage import CoverageTask

    setting = read_scenario(None if scenario is None else str(scenario))
    if profile is None and setting.profile_path is not None:
        reference = setting.fault("profile", "")
        profile, found = parse_named(read_text(setting.profile_path), model_file.parse_profile, reference)
        warn(found)
    if isinstance(profile, str | PathLike):
        profile = read_profile(profile, warn=warn)
    if options.turns_off and profile is None:
        message = "no computations to stop on turns; --profile names some"
        warn([Fault("--turns-off", 1, 1, message, severity="note")])
    flown = setting.keys.vehicle if vehicle is None else read_vehicle(read_text(str(vehicle)))
    pack_wh = None
    if vehicle is not None or "battery" in setting.chosen:
        battery = flown.battery if vehicle is not None else setting.keys.battery
        reserve = setting.keys.reserve_soc
        pack_wh = (1 - reserve) * battery.capacity_ah * battery.voltage_at((1 + reserve) / 2)
    wind_mps = setting.keys.wind.steady_mps
    task = CoverageTask.read(field, options, flown.name, flown.airframe, wind_mps, profile, pack_wh)
    speed_mps = math.hypot(*task.motion.wind_mps)
    if tight := too_tight(flown.airframe, task.motion.airspeed_mps, task.motion.min_radius_m, speed_mps):
        warn([Fault("--min-radius", 1, 1, tight, severity="warning")])
    return task


def cover_in_sorties(
    field: File,
    options: CoverageOptions,
    sorties: SortieOptions | None = None,
    profile: File | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
    resume: Sequence[File] = (),
    warn: Warn = _python_warnings,
) -> SortiePlan:
    """Plan the coverage of a field in the fewest flights from home and back, each with a full pack.

    Parameters
    ----------
    field, options, scenario, vehicle, warn
        As for `cover`; the options have a home.
    sorties : SortieOptions, optional
        How the field is divided, and among how many aircraft.
    profile : path, optional
    resume : sequence of paths, optional
        Flown result folders or telemetry: the ground that they covered is left out.

    Raises
    ------
    Infeasible
        If the field is out of reach of a pack, or no path of this pattern covers a part of it.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    from eadp.io.sorties.plan import SortieOptions, SortiePlanner
    from eadp.io.sorties.resume import resumed

    setting = read_scenario(None if scenario is None else str(scenario))
    flown = setting.keys.vehicle if vehicle is None else read_vehicle(read_text(str(vehicle)))
    if options.altitude_m is None:
        options = replace(options, altitude_m=flown.airframe.cruise_altitude_m)
    task = _coverage_task(str(field), options, profile, scenario, vehicle, warn)
    overrides: dict[str, Any] = {"start": {"altitude_m": 0.0}}
    if vehicle is not None:
        overrides["vehicle"] = str(vehicle)
    if options.wind is not None:
        east, north = task.motion.wind_mps
        from_deg = (90 - math.degrees(math.atan2(-north, -east))) % 360
        overrides |= {"wind.speed_mps": math.hypot(east, north), "wind.from_deg": round(from_deg, 6)}
    profile_path = None if profile is None else str(profile)
    scenario_path = None if scenario is None else str(scenario)
    planner = SortiePlanner(task, sorties or SortieOptions(), Files(), scenario_path, profile_path, overrides)
    if not resume:
        return planner.plan()
    planner, ground = resumed(planner, [*map(str, resume)], warn)
    return planner.plan(ground)


def sweep(
    file: File | Mapping[str, Any],
    jobs: int | None = 1,
    *,
    overrides: Overrides = (),
    out: File | None = None,
    scheduler: str | None = None,
    warn: Warn = _python_warnings,
) -> SweepFlights:
    """Fly a plan many times: a grid, zipped values, a random sample, several seeds, or a product of these.

    Parameters
    ----------
    file : path or mapping
        A sweep file, or its keys, whose paths are relative to the working directory.
    jobs : int or None, optional
        Number of processes; None is one for each core. A script that asks for more than one needs the guard
        `if __name__ == "__main__"`.
    overrides : mapping, or iterable of str, optional
        Set in every run, as for `simulate`.
    out : path, optional
        Results file that keeps the runs; those that it has are not made again.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers make the runs.
    warn : function, optional

    Returns
    -------
    list of SweepFlight
        A row for each run, in order: the varied keys' values and the figures of its flight, or its error. Its method
        `table` makes a table of it, of pandas, polars or Arrow.

    Raises
    ------
    InputError
        With every fault of the first file that has any.
    """
    from eadp.core.compiled import enable, enabled
    from eadp.io.sweep.flights import SweepFlights
    from eadp.io.sweep.results import Results
    from eadp.io.sweep.run import missing_runs
    from eadp.io.sweep.sweep_file import read_sweep

    texts: dict[str, Text] = {}
    path = _path(file, texts, "eadp.sweep/1")
    checked = read_sweep(texts.get(path) or read_text(path), read_overrides(override_texts(overrides)))
    warn(checked.warnings)
    indices, compiled = range(len(checked.design)), enabled()
    try:
        with closing(Results(None if out is None else str(out))) as results:
            results.expect(checked.run(index).key for index in indices)
            with missing_runs(checked, indices, results, jobs, scheduler) as (_, _, made):
                for _ in made:
                    pass
            return SweepFlights(checked.flights(indices, results.rows()))
    finally:
        enable(compiled)


def _path(given: Any, texts: dict[str, Text], schema: str = "") -> str:
    """The path of a file; an object becomes the text of its file, under the name that is returned."""
    if isinstance(given, str | PathLike):
        return str(given)
    if isinstance(given, Plan):
        text = Text("given.plan", writer.plan_text(given))
    elif isinstance(given, EnergyModel):
        from eadp.io.energy.model_file import energy_yaml

        text = Text("given-energy.yaml", energy_yaml(given))
    elif isinstance(given, Mapping):
        text = Text("given-keys.yaml", value_text({"schema": schema, **given}))
    else:
        text = Text("given-profile.yaml", model_file.profile_yaml(given))
    texts[text.name] = text
    return text.name
