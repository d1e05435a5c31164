"""Power of a profile at the configurations of `--at`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from eadp.errors import Fault, Infeasible, InputError, printable, refuse
from eadp.io.text.csv import NUMBER
from eadp.models.profile import configuration_text, shortest
from eadp.models.profile_sum import AnyProfile


def powers_at(profile: AnyProfile, asked: Sequence[str], clamp: bool) -> tuple[list[dict[str, Any]], list[Fault]]:
    """Power at configurations such as `fps=5,keysize=32`.

    Parameters
    ----------
    profile : Profile or ProfileSum
    asked : sequence of str
        Values of `--at`.
    clamp : bool
        Outside the measured range, take the nearest configuration inside.

    Returns
    -------
    list of dict
        The `values` of `eadp.power/1`.
    list of Fault
        A warning for each configuration that was clamped.

    Raises
    ------
    InputError
        With the faults of all the options.
    """
    values: list[dict[str, Any]] = []
    warnings: list[Fault] = []
    faults: list[Fault] = []
    for raw in asked:
        try:
            configuration = _configuration(raw, profile.names)
            power_w = profile.power_w_at(configuration, clamp)
        except InputError as error:
            faults += error.faults
            continue
        except Infeasible as error:
            faults.append(Fault("--at", 1, 1, str(error), "a value inside, or --clamp for the nearest", raw))
            continue
        extrapolated = not profile.contains(configuration)
        if extrapolated:
            taken = configuration_text(profile.names, profile.nearest(configuration), ",")
            message = f"{profile.outside(configuration)}: taken at {taken}"
            warnings.append(Fault("--at", 1, 1, message, severity="warning"))
        named = dict(zip(profile.names, map(shortest, configuration), strict=True))
        values.append({"configuration": named, "power_w": power_w, "extrapolated": extrapolated})
    refuse(faults)
    return values, warnings


def _configuration(raw: str, names: Sequence[str]) -> tuple[float, ...]:
    """Read `fps=5,keysize=32`: each parameter once."""
    values: dict[str, float] = {}
    faults, column = [], 1
    expected = ",".join(f"{name}=VALUE" for name in names)
    for part in raw.split(","):
        name, equals, text = (piece.strip() for piece in part.partition("="))
        if problem := _problem(part, name, equals, text, names, values):
            faults.append(Fault("--at", 1, column, problem, expected, raw))
        else:
            values[name] = float(text)
        column += len(part) + 1
    missing = [name for name in names if name not in values]
    if missing and not faults:
        faults.append(Fault("--at", 1, 1, f"no value for {', '.join(missing)}", expected, raw))
    refuse(faults)
    return tuple(values[name] for name in names)


def _problem(part: str, name: str, equals: str, text: str, names: Sequence[str], values: dict[str, float]) -> str:
    if not equals:
        return f"{printable(part.strip(), 80) or 'an empty text'} is no name=value"
    if name not in names:
        return f"no parameter {printable(name, 80) or 'without a name'}"
    if name in values:
        return f"{name} stands twice"
    finite = NUMBER.match(text) and math.isfinite(float(text))
    return "" if finite else f"{name} is {printable(text, 80) or 'empty'}, not a finite number"
