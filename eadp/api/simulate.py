"""A flight in simulation, and its forecast before take-off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from eadp.api.flight import Flight, fly_flight, forecast_values
from eadp.api.given import File, Overrides, Warn, python_warnings
from eadp.api.inputs import load_flight
from eadp.io.scenario import override_texts, read_overrides
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Plan
from eadp.models.profile import AnyProfile
from eadp.models.world import Step


def simulate(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | AnyProfile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    *,
    planner: str | None = None,
    seed: int | None = None,
    on_step: Callable[[Step], None] = lambda _step: None,
    warn: Warn = python_warnings,
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
    texts = override_texts(overrides, planner, seed)
    inputs = load_flight(plan, scenario=scenario, profile=profile, energy=energy, overrides=read_overrides(texts))
    warn(inputs.warnings)
    return fly_flight(inputs, inputs.preflight(), on_step, texts)


def forecast(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | AnyProfile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    *,
    planner: str | None = None,
    warn: Warn = python_warnings,
) -> dict[str, Any] | None:
    """Forecast a flight before take-off, without flying it.

    Parameters
    ----------
    plan, scenario, profile, energy, overrides, planner, warn
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
    keys = read_overrides(override_texts(overrides, planner))
    inputs = load_flight(plan, scenario=scenario, profile=profile, energy=energy, overrides=keys)
    warn(inputs.warnings)
    found = inputs.preflight()
    return None if found is None else forecast_values(found)
