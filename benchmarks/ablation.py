"""Variants of planner `joint` that each leave one concept out, flown beside it on the missions of `quality.py`.

    python benchmarks/quality.py --ablate --missions 200 --jobs 2 --write

A variant replaces constants and functions of the planner while it flies. `joint` itself has no option for any of them.
"""

from __future__ import annotations

import contextlib
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from measured import mean_text, table

from eadp.planning.base import NEW_STAGE, SOLVED
from eadp.planning.forecast import evaluate
from eadp.planning.forecast.evaluate import Evaluator
from eadp.planning.forecast.knapsack import fill_greedy
from eadp.planning.joint import planner, policy, search
from eadp.planning.joint.planner import JointPlanner
from eadp.planning.joint.policy import Policy
from eadp.planning.joint.program import ComputationProgram, Solution
from eadp.planning.joint.search import Place, Search, Shares

SEVERAL = """\
%: computations fps
%: trigger-radius 20
init:
n = 4
left  = -115, 150 - 2*sqrt(4900 + c1)
mid   = -40,  150 - 2*sqrt(4900 + c1)
right = 35,   150 - 2*sqrt(4900 + c1)
top   = 146,  (75 - sqrt(4900 + c1))/5
turn  = 11,   (75 - sqrt(4900 + c1))/5
low   = -11,  (75 - sqrt(4900 + c1))/5
path:
0.006; 90; (x - left - sqrt(4900 + c1))^2 + (y - top - c2)^2 - 4900 - c1
left, top + c2
SETS
0.1; 270; x - left
left, low - MORE
SETS
0.006; 90; (x - mid)^2 + (y - turn + MORE)^2 - 75^2
right, low - MORE
SETS
0.1; 90; x - right
right, top + c2
SETS
trig:
175, 161 + c2
"""
"""The survey with more path parameters: c2 shortens its lines at the top, c3 at the bottom."""

AS_IT_IS = "all rules"
must_search, along = JointPlanner._must_search, Search._along


@dataclass(frozen=True)
class Variant:
    """What a variant replaces: attributes of modules and classes."""

    replaced: tuple[tuple[Any, str, Any], ...] = ()

    @contextlib.contextmanager
    def flying(self) -> Iterator[None]:
        """The planner without it."""
        with contextlib.ExitStack() as patches:
            for owner, name, value in self.replaced:
                patches.enter_context(mock.patch.object(owner, name, value))
            yield


def _each_stage(self: JointPlanner, o: Any, kept: Any, cause: str) -> bool:
    return must_search(self, o, kept, cause) or (cause == NEW_STAGE and o.cursor.accepts_changes())


def _only_the_grid(self: Search, base: Shares, axis: int) -> list[Place]:
    return along(self, base, axis) if len(base) == 1 else []


def _no_effect(times_s: Any) -> tuple[Any, Any]:
    return np.ones(len(times_s)), np.zeros(len(times_s))


def _closed_form(_: ComputationProgram, knapsack: Any) -> Solution:
    return Solution(fill_greedy(knapsack), SOLVED)


VARIANTS: Mapping[str, Variant] = {
    AS_IT_IS: Variant(),
    "no halvings (`ROUNDS` = 0)": Variant(((search, "ROUNDS", 0),)),
    "no search along each parameter after the grid": Variant(((Search, "_along", _only_the_grid),)),
    "closed form instead of OSQP": Variant(((ComputationProgram, "solve", _closed_form),)),
    "the margin of today for the computations, too": Variant(
        ((evaluate.Evaluation, "adaptive", property(lambda own: own.knapsack)),)
    ),
    "the path searched at each new stage": Variant(((JointPlanner, "_must_search", _each_stage),)),
    "the same gain for each change of path": Variant(((Policy, "path_gain", property(lambda own: own._min_gain)),)),
    "no wait after a fall (`SETTLED_S` = 0)": Variant(((policy, "SETTLED_S", 0.0),)),
    "paths searched to the end (`LAST_CHANGE_S` = 0)": Variant(((planner, "LAST_CHANGE_S", 0.0),)),
    "the wind's estimate alone, without its variance": Variant(((evaluate, "_wind_effect", _no_effect),)),
    "an exact gauge": Variant(((Evaluator, "gain_std", lambda *_: 0.0),)),
}


def plans_of_several(folder: Path) -> dict[str, str]:
    """Plans with two and with three path parameters."""
    found = {}
    for name, more, count in (("two", "0", 1), ("three", "c3", 2)):
        sets = "\n".join(["[-1000, 0]", *["[-60, 0]"] * count, "[2, 10]"])
        path = folder / f"{name}.plan"
        path.write_text(SEVERAL.replace("SETS", sets).replace("MORE", more))
        found[name] = str(path)
    return found


def ablated(fly: Callable[[Mapping[str, Any]], dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """One mission by every variant."""
    fly({})  # compiled, parsed
    flights = {}
    for name, variant in VARIANTS.items():
        with variant.flying():
            flights[name] = fly({})
    return flights


def value(flight: Mapping[str, Any]) -> float:
    """U of a flight, 0 where it does not complete."""
    return float(flight["u"]) if flight["completed"] else 0.0


def row(name: str, flights: list[dict[str, Any]], beside: list[dict[str, Any]]) -> list[object]:
    """A variant's row: differences to other flights of the same missions, their mean and its standard error."""
    pairs = list(zip(flights, beside, strict=True))
    apart = [value(own) - value(other) for own, other in pairs]
    both = [own["u"] - other["u"] for own, other in pairs if own["completed"] and other["completed"]]
    cpu = sum(flight["cpu_s"] for flight in flights) / sum(flight["cpu_s"] for flight in beside)
    return [
        *(name, f"{statistics.fmean(map(value, flights)):.4f}", mean_text(apart), mean_text(both) if both else ""),
        *(sum(abs(one) > 1e-9 for one in apart), sum(one["completed"] for one in flights)),
        *(sum(one["kept"] for one in flights), f"{statistics.fmean(one['changes'] for one in flights):.2f}"),
        f"{cpu:.2f}",
    ]


TITLES = (
    *("U, all", "difference", "where both complete", "missions that differ"),
    *("completed", "reserve kept", "changes", "CPU, ratio"),
)


def compare(title: str, names: Iterable[str], beside: str, missions: list[dict[str, dict[str, Any]]]) -> None:
    """Print flights of the same missions, each kind beside one of them; U counts 0 where a mission is not completed."""
    if missions:
        own = [mission[beside] for mission in missions]
        table((title, *TITLES), (row(name, [mission[name] for mission in missions], own) for name in names))
