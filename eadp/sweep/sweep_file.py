"""The sweep file: the flights to make of a plan, a profile and a scenario, checked before the first of them."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le, Len, Lt
from pydantic import Field

from eadp.api.flight import SCHEMA as FLIGHT_SCHEMA
from eadp.api.inputs import Files, FlightInputs, load_flight
from eadp.errors import Fault, InputError, one_of, printable, refuse
from eadp.io.energy import parse_energy
from eadp.io.plan.sources import PlanReader
from eadp.io.profile.model_file import parse_profile
from eadp.io.scenario import Scenario, ScenarioFile, beside, override_key, plain, vehicle_path
from eadp.io.text.streams import Text
from eadp.io.text.yaml import STRICT, Document, keys_document, validated
from eadp.io.text.yaml import Path as KeyPath
from eadp.io.vehicle import replaced
from eadp.plug_ins import code_identity
from eadp.sweep.engines import Run
from eadp.sweep.results import SORTED, SweepFlight

SCHEMA = "eadp.sweep/1"
FILES = ("plan", "scenario", "profile", "energy")
SHORT = {"planner": "planner.name"}
"""Keys that stand for others; `c1` for `parameters.c1` is one of all scenarios' overrides."""

RUNS_LIMIT = 1_000_000
Count = Annotated[int, Ge(1), Le(RUNS_LIMIT)]
Two = Annotated[Sequence[float], Len(2, 2)]
_STANDARD = NormalDist()
Values = Annotated[list[Any], Field(min_length=1)]


@dataclass(frozen=True)
class Law:
    """The distribution of a key: one of the three."""

    uniform: Two | None = None
    """[low, high]"""

    normal: Two | None = None
    """[mean, standard deviation]"""

    choice: Annotated[Sequence[Any], Len(1)] | None = None
    """any of these values, each as likely"""

    @property
    def given(self) -> list[str]:
        """The distributions that it has: one, unless it is faulty."""
        return [name for name, values in vars(self).items() if values is not None]

    def at(self, share: float) -> Any:
        """The quantile of a share in (0, 1)."""
        if self.choice is not None:
            return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]
        if self.uniform is not None:
            low, high = self.uniform
            return low + (high - low) * share
        mean, std = self.normal or (0.0, 0.0)
        return mean + std * _STANDARD.inv_cdf(share)


@dataclass(frozen=True)
class SampleDesign:
    """Keys drawn at random together, `runs` times: independently, or as a Latin hypercube.

    Every key has a generator of its own: another key does not change the draws of the keys before it, nor do more runs
    of method random.
    """

    runs: Count
    """number of runs"""

    keys: Annotated[Mapping[str, Law], Len(1)]
    """distributions by varied key"""

    seed: Annotated[int, Ge(0), Lt(2**63)] = 0
    """seed of the draws"""

    method: Literal["random", "latin"] = "random"
    """latin: a Latin hypercube"""

    @cached_property
    def draws(self) -> dict[str, list[Any]]:
        """Each key's value in each run."""
        return {name: [law.at(u) for u in self._shares(j)] for j, (name, law) in enumerate(self.keys.items())}

    def _shares(self, column: int) -> list[float]:
        """A number in (0, 1) for each run; of a Latin hypercube, one in each of `runs` equal parts, in random order."""
        generator = np.random.default_rng([self.seed, column])
        if self.method == "latin":
            parts = generator.permutation(self.runs)
            shares = (parts + generator.random(self.runs)) / self.runs
        else:
            shares = generator.random(self.runs)
        # a normal's quantiles are infinite at 0 and 1
        values: list[float] = np.clip(shares, 2.0**-54, 1 - 2.0**-53).tolist()
        return values


@dataclass(frozen=True)
class DesignPoint:
    """One run of a design: the varied keys' values, and the seed if the design sets one."""

    index: int
    values: Mapping[str, Any]
    seed: int | None


@dataclass(frozen=True)
class Design:
    """The product of a grid, of zipped values, of a sample, and of seeds; the last changes fastest.

    Its points are computed on demand: a design of a million takes no memory.
    """

    grid: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    zipped: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    sample: SampleDesign | None = None
    seeds: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The varied keys."""
        return (*self.grid, *self.zipped, *(self.sample.keys if self.sample else ()))

    @cached_property
    def _sizes(self) -> tuple[int, ...]:
        together = min((len(values) for values in self.zipped.values()), default=1)
        drawn = self.sample.runs if self.sample else 1
        return (*(len(values) for values in self.grid.values()), together, drawn, self.seeds or 1)

    @property
    def size(self) -> int:
        """The number of its points, however large."""
        return math.prod(self._sizes)

    def __len__(self) -> int:
        return self.size

    def point(self, index: int) -> DesignPoint:
        """The point of an index, from 0."""
        places, rest = list[int](), index
        for size in reversed(self._sizes):
            rest, place = divmod(rest, size)
            places.insert(0, place)
        *axes, together, drawn, seed = places
        values = {name: choices[i] for (name, choices), i in zip(self.grid.items(), axes, strict=True)}
        values |= {name: choices[together] for name, choices in self.zipped.items()}
        if self.sample:
            values |= {name: draws[drawn] for name, draws in self.sample.draws.items()}
        return DesignPoint(index, values, None if self.seeds is None else seed)


@dataclass(frozen=True)
class SweepKeys:
    """A sweep file. Paths are relative to it; varied keys are a scenario's, dotted, or name a file or the planner."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.sweep/1"]
    """name and version of the format"""

    plan: str | None = None
    """path of the plan or the mission that is flown, unless it is varied"""

    scenario: str | None = None
    """path of the scenario; by default the defaults"""

    profile: str | None = None
    """instead of the scenario's"""

    energy: str | None = None
    """path of an energy model made by eadp fit"""

    grid: dict[str, Values] = field(default_factory=dict)
    """every combination of these values"""

    zip: dict[str, Values] = field(default_factory=dict)
    """the first values together, the second ones, …"""

    sample: SampleDesign | None = None
    """keys drawn at random together"""

    seeds: Count | None = None
    """each run with seeds 0 to n - 1; else the scenario's own"""


@dataclass(frozen=True)
class Sweep:
    """A checked sweep: its design, the texts of all its files, and the warnings of reading them."""

    name: str
    design: Design
    kept: Files
    files: Mapping[str, str]
    overrides: Mapping[str, Any]
    scenarios: Mapping[str, Scenario] = field(repr=False)
    warnings: tuple[Fault, ...] = ()

    def seed(self, point: DesignPoint) -> int:
        """The seed of a run: the design's, else a varied one, else the scenario's."""
        if point.seed is not None:
            return point.seed
        scenario = self._files(point).get("scenario")
        own = self.scenarios[scenario].keys.seed if scenario else 0
        return int(point.values.get("seed", self.overrides.get("seed", own)))

    def _files(self, point: DesignPoint) -> dict[str, str]:
        """The paths of a run's files by kind."""
        files = dict(self.files)
        for kind in FILES:
            if kind in point.values:
                files[kind] = beside(self.name, point.values[kind])
        return files

    def run(self, index: int) -> Run:
        """The run of an index."""
        point = self.design.point(index)
        overrides = dict(self.overrides)
        for name, value in point.values.items():
            if name not in FILES:
                overrides[full_key(name)] = value
        overrides["seed"] = self.seed(point)
        files = self._files(point)
        return Run(self._key(files, overrides), files, overrides)

    def keys(self) -> Iterator[str]:
        """The keys of all runs, in order."""
        return (self.run(index).key for index in range(len(self.design)))

    def flights(self, rows: Iterable[Mapping[str, Any]]) -> list[SweepFlight]:
        """The runs with the figures of their rows in the results."""
        points = map(self.design.point, range(len(self.design)))
        return [
            SweepFlight(index=point.index, values=point.values, seed=self.seed(point), **row)
            for point, row in zip(points, rows, strict=True)
        ]

    def _key(self, files: Mapping[str, str], overrides: Mapping[str, Any]) -> str:
        """A hash of all that a run depends on: files by content, overrides with the seed, and the code."""
        contents = {kind: self._digests[path] for kind, path in files.items()}
        if "profile" not in contents:
            own = self.scenarios[files["scenario"]].profile_path if "scenario" in files else None
            contents["profile"] = self._digests[own] if own else ""
        vehicle = vehicle_path(self.kept.document(files.get("scenario")), overrides)
        if vehicle is not None:
            contents["vehicle"] = digest(self.kept.text(vehicle))
        whole = [FLIGHT_SCHEMA, code_identity(), contents, dict(overrides)]
        return hashlib.sha256(SORTED.encode(whole).encode()).hexdigest()[:32]

    @cached_property
    def _digests(self) -> dict[str, str]:
        return {path: digest(text) for path, text in self.kept.texts.items()}


def digest(text: Text) -> str:
    """A hash of a file's content and of its suffix, which may decide how it is read."""
    return hashlib.sha256(f"{Path(text.name).suffix}\0{text.body}".encode()).hexdigest()


def full_key(name: str) -> str:
    """The scenario's key that a varied one stands for."""
    return SHORT.get(name) or override_key(name) or name


def read_sweep(given: Text | Mapping[str, Any], overrides: Mapping[str, Any] | None = None) -> Sweep:
    """Read a sweep file and every file it names, and check every value it lists by the scenario's schema.

    Parameters
    ----------
    given : Text or mapping
        The file, or its keys.
    overrides : mapping of dotted key to value, optional
        Set in every run, as `read_override` gives them.

    Raises
    ------
    InputError
        With every fault of the first file that has any; a value that no flight accepts is a fault of the sweep file.
    """
    if isinstance(given, Text):
        document = keys_document(given, SCHEMA)
    else:
        document = Document(Text("given-keys.yaml", ""), {"schema": SCHEMA, **plain(given)})
    keys = validated(SweepKeys, document, document.value, lambda keys: _faults(keys, document))
    design = Design(keys.grid, keys.zip, keys.sample, keys.seeds)
    if design.size > RUNS_LIMIT:
        message = f"{design.size} runs are more than {RUNS_LIMIT}"
        raise InputError(document.fault((), message, f"a sweep of at most {RUNS_LIMIT} runs"))
    overrides = dict(overrides or {})
    _check_fixed(overrides, design)
    named = _named_files(document, keys)
    kept = _texts_of(document, named)
    files = {each.kind: each.path for each in named if not each.is_varied}
    sweep = Sweep(document.name, design, kept, files, overrides, _scenarios(document, named, kept, overrides))
    _check_values(document, keys, sweep)
    return replace(sweep, warnings=_read_all(document, keys, named, sweep))


# --- the design, and checks beyond the schema


class VariedKey(NamedTuple):
    """A key that is varied, and where it stands.

    `values` are those listed; of a distribution its bounds or its mean, which the scenario's schema has to take, too.
    """

    name: str
    location: KeyPath
    values: list[Any]
    values_location: KeyPath


def _varied_keys(keys: SweepKeys) -> Iterator[VariedKey]:
    for part in ("grid", "zip"):
        for name, values in getattr(keys, part).items():
            yield VariedKey(name, (part, name), values, (part, name))
    for name, drawn in keys.sample.keys.items() if keys.sample else ():
        location = ("sample", "keys", name)
        law = (drawn.given or ["choice"])[-1]  # of several, or none, it is a fault elsewhere
        values = getattr(drawn, law) or []
        # the second of a normal distribution is its deviation
        yield VariedKey(name, location, values[:1] if law == "normal" else values, (*location, law))


def _listed(keys: SweepKeys) -> Iterator[tuple[str, Any, KeyPath]]:
    """Every listed value of a varied key, with its location."""
    for key in _varied_keys(keys):
        yield from ((key.name, value, (*key.values_location, i)) for i, value in enumerate(key.values))


def _faults(keys: SweepKeys, document: Document) -> list[Fault]:
    faults = [*_name_faults(keys, document), *_zip_faults(keys, document), *_sample_faults(keys, document)]
    names = {key.name for key in _varied_keys(keys)}
    if keys.plan is None and "plan" not in names:
        faults.append(document.fault((), "no plan to fly", "plan: FILE"))
    if keys.seeds is not None and "seed" in names:
        faults.append(document.fault(("seeds",), "seeds, and the key seed too", "one or the other"))
    return faults


def _name_faults(keys: SweepKeys, document: Document) -> list[Fault]:
    """Unknown keys, and keys that are varied twice or contain one another."""
    faults = []
    seen: dict[str, str] = {}
    for name, location, *_ in _varied_keys(keys):
        if name not in FILES and override_key(name) is None:
            message = f"{printable(name)} is not a key"
            faults.append(document.fault(location, message, "a scenario's, as wind.speed_mps"))
            continue
        full = name if name in FILES else full_key(name)
        clash = next((other for other in seen if _overlap(full, other)), None)
        if clash is not None:
            message = f"{printable(name)} and {printable(seen[clash])} set the same key"
            faults.append(document.fault(location, message, "one of them"))
        seen[full] = name
    return faults


def _overlap(one: str, other: str) -> bool:
    """Whether two keys are the same, one contains the other, or an override of one removes the other."""
    section, _, last = other.rpartition(".")
    if one.rpartition(".")[0] == section and last in replaced(one):
        return True
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _zip_faults(keys: SweepKeys, document: Document) -> list[Fault]:
    lengths = {name: len(values) for name, values in keys.zip.items()}
    first = next(iter(lengths.values()), 0)
    return [
        document.fault(("zip", name), f"{name} has {count} values, the first key {first}", f"{first} values")
        for name, count in lengths.items()
        if count != first
    ]


def _sample_faults(keys: SweepKeys, document: Document) -> list[Fault]:
    faults = []
    for name, drawn in keys.sample.keys.items() if keys.sample else ():
        location = ("sample", "keys", name)
        if len(drawn.given) != 1:
            message = f"{name} has {len(drawn.given)} distributions"
            faults.append(document.fault(location, message, "uniform, normal or choice"))
        elif drawn.uniform and drawn.uniform[0] > drawn.uniform[1]:
            faults.append(document.fault((*location, "uniform"), "the lower end is above the upper one", "[low, high]"))
        elif drawn.normal and drawn.normal[1] < 0:
            message = "a standard deviation below 0"
            faults.append(document.fault((*location, "normal"), message, "[mean, standard deviation]"))
        elif name in FILES and not drawn.choice:
            faults.append(document.fault(location, f"{name} is a file", "choice: [FILE, …]"))
    return faults


def _check_fixed(overrides: Mapping[str, Any], design: Design) -> None:
    """Refuse a key set in every run that is a file or varied."""
    for key in overrides:
        if key in FILES:
            raise InputError.at("--set", 1, 1, f"{key} is a file", "it in the sweep file", key)
        if any(name not in FILES and _overlap(key, full_key(name)) for name in design.names):
            raise InputError.at("--set", 1, 1, f"{key} is varied by the sweep", "a key that is not", key)
        if key == "seed" and design.seeds is not None:
            raise InputError.at("--set", 1, 1, "the sweep has seeds", "a key that it does not vary", key)


# --- files, and values checked in them


class _NamedFile(NamedTuple):
    """A file that the sweep file names: its kind, its path, and where it is named."""

    kind: str
    path: str
    location: KeyPath

    @property
    def is_varied(self) -> bool:
        """Whether it is one of several, and not that of all runs."""
        return self.location != (self.kind,)


def _named_files(document: Document, keys: SweepKeys) -> list[_NamedFile]:
    """Every file that the sweep file names."""
    given = [(kind, getattr(keys, kind)) for kind in FILES]
    named: list[tuple[str, Any, KeyPath]] = [(kind, value, (kind,)) for kind, value in given if value is not None]
    named += [(name, value, location) for name, value, location in _listed(keys) if name in FILES]
    wrong = [location for _, value, location in named if not isinstance(value, str)]
    refuse([document.fault(location, "not a file name", "a path relative to this file") for location in wrong])
    return [_NamedFile(kind, beside(document.name, value), location) for kind, value, location in named]


def _texts_of(document: Document, named: list[_NamedFile]) -> Files:
    """The files, read; one that cannot be read is a fault of the sweep file."""
    kept, faults = Files(), []
    for _, path, location in named:
        try:
            kept.text(path)
        except InputError as error:
            fault = error.faults[0]
            faults.append(document.fault(location, f"{printable(path)} {fault.message}", fault.expected))
    refuse(faults)
    return kept


def _scenarios(
    document: Document, named: list[_NamedFile], kept: Files, overrides: Mapping[str, Any]
) -> dict[str, Scenario]:
    """Every scenario of the sweep, by path; the profiles that they name are added to the texts."""
    # a varied scenario comes after the one of all runs, and replaces it
    stated = [each for each in named if each.kind == "scenario"]
    for each in stated:
        kept.document(each.path)
    flown = [each for each in stated if each.is_varied] or stated
    scenarios = {each.path: kept.scenario(each.path, overrides) for each in flown}
    if not any(each.kind == "profile" for each in named):
        for scenario in scenarios.values():
            if scenario.profile_path is not None:
                kept.text(scenario.profile_path)
    return scenarios


def _check_values(document: Document, keys: SweepKeys, sweep: Sweep) -> None:
    """Read the scenario with each listed value: what its schema refuses is a fault of the sweep file."""
    scenario = next(iter(sweep.scenarios), None)
    faults: list[Fault] = []
    checked: set[str] = set()
    for name, value, location in _listed(keys):
        token = f"{name}={json.dumps(value, sort_keys=True)}"
        if name in FILES or token in checked:
            continue
        checked.add(token)
        try:
            sweep.kept.scenario(scenario, {**sweep.overrides, full_key(name): value})
        except InputError as error:
            faults += [document.fault(location, fault.message, fault.expected) for fault in error.faults]
    refuse(list(dict.fromkeys(faults)))


def _check_titles(document: Document, keys: SweepKeys, titles: Set[str]) -> None:
    """Refuse varied keys that are neither a scenario's, nor c1, c2, …, nor the title of a parameter of any plan."""
    known = [*sorted(titles), *ScenarioFile.__dataclass_fields__]
    refuse(
        [
            document.fault(location, f"unknown key {name}", one_of(known, name))
            for name, location, *_ in _varied_keys(keys)
            if not (_is_of_a_scenario(name) or name in titles or re.fullmatch("c[0-9]+", name))
        ]
    )


def _is_of_a_scenario(name: str) -> bool:
    """Whether a varied key is one of a scenario or a file, and not the bare name of a parameter."""
    return name in FILES or full_key(name) != f"parameters.{name}"


def _read_all(document: Document, keys: SweepKeys, named: list[_NamedFile], sweep: Sweep) -> tuple[Fault, ...]:
    """Read every plan, profile and energy model once; what the first run is warned about."""
    parsers: dict[str, Callable[[Text], Any]] = {"plan": PlanReader(), "profile": parse_profile, "energy": parse_energy}
    titles: set[str] = set()
    for kind, path, _ in named:
        if kind in parsers:
            _, content = sweep.kept.read(path, parsers[kind])
            if kind != "energy":
                read = content[0]
                titles |= {item.title for item in read.parameters} if kind == "plan" else set(read.names)
    _check_titles(document, keys, titles - {""})
    try:
        return load_run(sweep.kept, sweep.run(0)).warnings
    except InputError:
        return ()  # a run that cannot be made is a row of the results


def load_run(files: Files, run: Run) -> FlightInputs:
    """The flight of a run, ready to be flown."""
    given: dict[str, Any] = {**run.files}  # plan, scenario, profile and energy, as far as there are any
    return load_flight(**given, overrides=run.overrides, files=files)
