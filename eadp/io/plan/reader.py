"""Reader of plan text: the papers' format and its dialects.

Source: draft 002, Appendix II.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

from eadp.core.expressions.reader import read_expression, read_expressions
from eadp.core.expressions.tree import FUNCTIONS, Expression, constant, difference, number_text, substituted, total
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import FARTHEST_M
from eadp.errors import ExpressionError, Fault, PathUndefined, printable, refuse
from eadp.io.plan.headers import HEADERS, HELD, RADIUS, REPEATED, STAGE_HEADERS, named_unit, read_box, read_number
from eadp.io.plan.writer import parameters_of, point_text
from eadp.io.text.streams import Text
from eadp.models.airspace import Airspace, Field
from eadp.models.plan.plan import Finding, Plan, ShortForm, Site
from eadp.models.plan.stage import ROTATIONS, Box, LoopVariable, PointExpression, Segment, Stage, Title
from eadp.models.plan.structure import equal, find_structure, moves_with, shifts_agree, tidy

_NUMBERED = re.compile(r"\s*([0-9]{1,9})\s*:")
_SECTION = re.compile(r"\s*(init|path|trig)\s*:\s*\Z")
_DEFINITION = re.compile(r"\s*([A-Za-z][A-Za-z0-9]*)\s*=")
_LIKE_DECIMALS = re.compile(r"\A[^,]*[0-9],[0-9]+,\s|,\s[^,]*[0-9],[0-9]+\s*\Z")
"""Three numbers of which two are written as one with a decimal comma: `0,5, 400`."""
_RESERVED = re.compile(r"(x|y|pi|n|c[0-9]+)\Z")
VARIABLES_LIMIT = 200
"""Most loop variables of a segment."""
LIMIT_STAGES = 10_000
"""Most stages of a plan: a survey has hundreds."""

STAGE_EXPECTED = "gain; rotation; path, as in 0.05; 270; x+115"

T = TypeVar("T")


@dataclass(slots=True)
class _Line:
    """A line of the file without its printed number; `column` is where its text starts, from 1."""

    number: int
    text: str
    column: int

    def part(self, start: int, end: int | None = None) -> _Line:
        """A part of the line, without the blanks before it."""
        text = self.text[start:end]
        start += len(text) - len(text.lstrip())
        return _Line(self.number, text.lstrip(), self.column + start)

    def split(self, mark: str) -> list[_Line]:
        """The parts between marks."""
        parts = self.text.split(mark)
        starts = itertools.accumulate((len(each) + 1 for each in parts), initial=0)
        return [self.part(start, start + len(each)) for start, each in zip(starts, parts, strict=False)]


_START = _Line(1, "", 1)


@dataclass(slots=True)
class _Draft:
    """A stage being read; parts that could not be read stay None."""

    line: _Line
    gain: float | None = None
    rotation: int | None = None
    path: Expression | None = None
    path_line: _Line = field(default_factory=lambda: _START)
    trigger: PointExpression | None = None
    trigger_line: _Line | None = None
    radius_m: float | None = None
    flown: dict[str, Any] = field(default_factory=dict)
    sets: list[Box | None] = field(default_factory=list)
    set_lines: list[_Line] = field(default_factory=list)


@dataclass(slots=True)
class _Group:
    """The sections of one segment: its loop variables by name (a shift of None is a formula), stages, and end.

    `drafts` is the index of its first stage. A segment with a condition `until` is flown lap by lap until it holds.
    """

    line: _Line
    drafts: int
    init: bool = False
    coordinates: dict[str, tuple[Expression, Expression | None, _Line]] = field(default_factory=dict)
    n: tuple[int, _Line] | None = None
    final: PointExpression | None = None
    until: tuple[Expression, Expression] | None = None
    final_line: _Line = field(default_factory=lambda: _START)


def read_plan(text: Text) -> tuple[Plan, list[Finding]]:
    """Read a plan, with warnings about it.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    return _Reader(text).plan()


class _Reader:
    def __init__(self, text: Text) -> None:
        self._source = text
        self._faults: list[Fault] = []
        self._findings: list[Finding] = []
        self._drafts: list[_Draft] = []
        self._headers: dict[str, _Line] = {}
        self._values: dict[str, Any] = {}
        self._areas: list[tuple[str, _Line, Any]] = []
        self._header_shift: PointExpression | None = None
        self._header_shift_line = _START
        self._section = ""
        self._groups: list[_Group] = []
        self._numbered = 0
        self._flown: dict[str, float | None] = {}
        self._commands: list[tuple[float, ...]] = []

    @property
    def _coordinates(self) -> Mapping[str, object]:
        """Names that may stand in stages and triggers here."""
        return self._groups[-1].coordinates if self._groups else {}

    # --- the whole file

    def plan(self) -> tuple[Plan, list[Finding]]:
        for number, raw in enumerate(self._source.lines, 1):
            line = self._unnumbered(number, raw)
            if line is not None and line.text.strip():
                self._read_line(line)
            if len(self._drafts) > LIMIT_STAGES:
                raise self._source.error((number, 1), f"more than {LIMIT_STAGES} stages", "as many or fewer")
        if not self._drafts and not self._faults:
            self._fault(_START, "no stage", STAGE_EXPECTED)
        self._finish_stages()
        refuse(self._faults)
        plan = self._assembled()
        refuse(self._faults)
        self._check_place(plan)
        refuse(self._faults)
        return plan, self._findings

    def _check_place(self, plan: Plan) -> None:
        """Refuse a plan that is far from where its header says, as with coordinates of a grid."""
        if plan.site.origin_deg is None:
            return
        places = [place for place in (plan.site.home_m, plan.site.start_m) if place is not None]
        with suppress(PathUndefined):  # which is found where it is flown
            places += [stage.trigger_at(parameters_of(plan, ())) for stage in plan.stages]
        far = next((place for place in places if math.hypot(*place) > FARTHEST_M), None)
        if far is not None:
            message = f"the plan reaches {math.hypot(*far) / 1000:.0f} km from there, as at ({far[0]:g}, {far[1]:g}) m"
            expected = f"metres from it, at most {FARTHEST_M / 1000:g} km"
            self._fault(self._headers["origin"], message, expected)

    def _unnumbered(self, number: int, raw: str) -> _Line | None:
        """The line without its printed number; comments become headers or nothing."""
        line = _Line(number, raw, 1)
        if match := _NUMBERED.match(raw):
            printed = int(match[1])
            if printed <= self._numbered:
                expected = f"a number above {self._numbered}"
                self._fault(line, f"line number {printed}", expected, match.start(1))
            self._numbered = max(self._numbered, printed)
            line = line.part(match.end())
        start = line.text.lstrip()[:2]
        if start == "%:":
            self._read_header(line.part(0).part(2))
        return None if start[:1] in ("%", "#") else line

    def _read_line(self, line: _Line) -> None:
        section = _SECTION.match(line.text)
        if section:
            if self._drafts and not self._groups:
                what = f"a section {section[1]}: after stages without sections"
                self._fault(line, what, "sections from the start")
            self._begin_section(section[1], line)
        elif self._section == "init":
            self._read_definition(line)
        elif self._section == "trig":
            self._read_end(line)
        else:
            self._read_stage_line(line)

    # --- sections

    def _begin_section(self, name: str, line: _Line) -> None:
        """A section: of the current segment, or the first of the next."""
        group = self._groups[-1] if self._groups else None
        staged = group is not None and len(self._drafts) > group.drafts
        if group is None or name == "init" or (name == "path" and (staged or not group.init)):
            self._groups.append(_Group(line, len(self._drafts), init=name == "init"))
        self._section = name

    def _read_end(self, line: _Line) -> None:
        """The line of a section `trig:`: a final point, or the condition on which laps end."""
        group = self._groups[-1]
        if group.final is not None or group.until is not None:
            self._fault(line, "a second final point", "one")
        group.final_line = line
        left, sign, _ = line.text.partition(">=")
        if not sign:
            group.final = self._point(line, "a final point like 175, 161")
            return
        if not group.init:
            self._fault(line, "an end of laps without a section init:", "a section init: that names a coordinate")
        sides = (self._scalar(line.part(0, len(left))), self._scalar(line.part(len(left) + 2)))
        group.until = (sides[0] or _NOWHERE[0], sides[1] or _NOWHERE[1])

    def _scalar(self, line: _Line) -> Expression | None:
        """A number in parameters and loop variables."""
        value = self._expression(line)
        free = value is not None and self._is_free(line, [value], "a value", "numbers and names")
        return value if free else None

    def _read_stage_line(self, line: _Line) -> None:
        stripped = line.text.lstrip()
        if stripped.startswith("["):
            self._read_set(line)
        elif ";" in line.text:
            self._read_head(line)
        elif not self._drafts:
            if self._header_shift is not None or self._groups:
                self._fault(line, "neither a stage nor a header", STAGE_EXPECTED)
            else:
                self._header_shift_line = line
                self._header_shift = self._point(line, "a shift like -10, -1, or " + STAGE_EXPECTED) or _NOWHERE
        elif self._drafts[-1].trigger_line is not None:
            what = f"stage {len(self._drafts)} has its trigger already"
            self._fault(line, what, "a set like [2, 10] or a new stage")
        else:
            self._read_trigger(line)

    # --- lines of a stage

    def _read_head(self, line: _Line) -> None:
        draft = _Draft(line, flown=self._flown | {"commands": tuple(self._commands)})
        self._commands = []
        self._drafts.append(draft)
        parts = line.split(";")
        if len(parts) != 3:
            self._fault(line, f"a stage with {len(parts)} parts between semicolons", STAGE_EXPECTED)
            return
        gain, rotation, draft.path_line = parts
        draft.gain = self._number(gain, "a gain of 0 or more", lambda value: value >= 0)
        expected = "a rotation of 90 or 270 (or 0 for 90, 1 for 270)"
        degrees = self._number(rotation, expected, lambda value: value in (0, 1, 90, 270))
        if degrees is not None:
            draft.rotation = {0: 90, 1: 270}.get(int(degrees), int(degrees))
        draft.path = self._expression(draft.path_line)
        if draft.path is not None and not draft.path.names & {"x", "y"}:
            self._fault(draft.path_line, "a path that names neither x nor y", "a path function of x and y")

    def _read_trigger(self, line: _Line) -> None:
        draft = self._drafts[-1]
        draft.trigger_line = line
        end = _second_comma(line.text)
        if end is not None:
            radius = line.part(end + 1)
            draft.radius_m = self._number(radius, *RADIUS)
            if _LIKE_DECIMALS.search(line.text):
                message = f"a trigger with a radius of {printable(radius.text.strip(), 40)} m, or a decimal comma"
                self._warn(line, "comma", message, len(self._drafts))
        draft.trigger = self._point(line.part(0, end), f"the trigger of stage {len(self._drafts)}, like -115, 146")

    def _read_set(self, line: _Line) -> None:
        if not self._drafts:
            self._fault(line, "a set before the first stage", STAGE_EXPECTED)
            return
        draft = self._drafts[-1]
        which = f" as set {len(draft.sets) + 1} of stage {len(self._drafts)}"
        draft.sets.append(self._attempt(line, partial(read_box, which=which)))
        draft.set_lines.append(line)

    # --- sections of the short form

    def _read_definition(self, line: _Line) -> None:
        group = self._groups[-1]
        match = _DEFINITION.match(line.text)
        if not match:
            self._fault(line, "no definition", "n = 4, or a coordinate like p1x = -115, 10")
            return
        name, own, values = match[1], line.part(0), line.part(match.end())
        if name == "n":
            n = self._number(values, "a whole number of stages, 1 or more", lambda v: v >= 1 and v == int(v))
            if group.n is not None:
                self._fault(own, "n stands twice", "it once")
            if n is not None:
                group.n = (int(n), line)
            return
        if _RESERVED.match(name) or name in FUNCTIONS:
            self._fault(own, f"{name} cannot be the name of a coordinate", "another name")
        elif name in group.coordinates:
            self._fault(own, f"the coordinate {name} stands twice", "it once")
        # it may name what stands below it, if its laps end on a condition: read once all is known
        group.coordinates[name] = (*_NOWHERE, values)

    def _read_definitions(self, group: _Group) -> None:
        """The coordinates, each a first value and a shift; of a segment that ends on a condition formulas, too."""
        names = set(group.coordinates) if group.until else set[str]()
        count, expected = (None, "") if group.until else (2, "a first value and a shift, like -115, 10")
        if len(names) > VARIABLES_LIMIT:
            self._fault(group.line, f"{len(names)} loop variables in a segment", f"at most {VARIABLES_LIMIT}")
            return
        for name, (_, _, line) in group.coordinates.items():
            values = self._attempt(line, partial(read_expressions, names=names, count=count), expected)
            if values is None:  # the name stays defined: one mistake is one fault
                continue
            if len(values) > 2:
                self._fault(line, f"{len(values)} values", "a first value and a shift, or a formula alone")
            elif self._is_free(line, values, "a coordinate", "numbers and parameters"):
                first, shift = values if len(values) == 2 else (values[0], None)
                group.coordinates[name] = (first, shift, line)
                if shift is not None and (used := sorted(first.names & names)):
                    what = f"the first value of {name} names {used[0]}"
                    self._fault(line, what, "numbers and parameters", first.offsets[used[0]])
        formulas = [name for name, (_, shift, _) in group.coordinates.items() if shift is None]
        for i, name in enumerate(formulas):
            formula, _, line = group.coordinates[name]
            for other in sorted(formula.names.intersection(formulas[i:])):
                what = "itself" if other == name else f"{other}, which stands below it"
                self._fault(line, f"{name} is computed from {what}", "formulas above it", formula.offsets[other])

    # --- headers

    def _read_header(self, line: _Line) -> None:
        key, _, rest = line.text.strip().partition(" ")
        own = line.part(len(line.text.rstrip()) - len(rest.lstrip()))
        if key in STAGE_HEADERS:
            value = self._attempt(own, STAGE_HEADERS[key])
            if key in HELD:
                self._flown[HELD[key]] = value
            elif value is not None:
                self._commands.append(value)
        elif key not in HEADERS:
            known = ", ".join((*HEADERS, *STAGE_HEADERS))
            self._warn(line, "unknown-header", f"unknown header {printable(key, 40)}; expected one of {known}")
        else:
            header = HEADERS[key]
            value = self._attempt(own, header.read) if header.read else None
            if key in REPEATED:
                self._areas.append((key, own, value))
                return
            if key in self._headers:
                self._fault(line, f"the header {key} stands twice", "it once")
            self._headers[key] = own
            if value is not None:
                self._values[key] = value

    def _of(self, place: str) -> dict[str, Any]:
        """What headers state of the plan, or of its site, by attribute."""
        found = ((HEADERS[key].attribute.rpartition("."), value) for key, value in self._values.items())
        return {name: value for (of, _, name), value in found if of == place and name}

    def _site(self) -> Site:
        obstacles = [value for key, _, value in self._areas if key == "avoid" and value]
        boundary = [value for key, _, value in self._areas if key == "inside" and value]
        named = (each if each.name else each._replace(name=f"obstacle {i}") for i, each in enumerate(obstacles, 1))
        return Site(field=self._field(), airspace=Airspace(tuple(named), tuple(boundary)), **self._of("site"))

    def _field(self) -> Field | None:
        """The field: the outline of each part counter-clockwise, and its holes clockwise."""
        parts: list[list[tuple[_Line, tuple[Point, ...]]]] = []
        for key, line, ring in self._areas:
            if key == "field":
                parts.append([])
            elif key == "hole" and not parts:
                self._fault(line, "a hole of no field", "a header field before it")
                return None
            if key in ("field", "hole"):
                parts[-1].append((line, ring))
        if not parts or not all(ring for part in parts for _, ring in part):
            return None
        from eadp.core.geometry.polygons import flaw, signed_area_m2

        outlines = []
        for part in parts:
            rings = [ring if (signed_area_m2(ring) > 0) == (i == 0) else ring[::-1] for i, (_, ring) in enumerate(part)]
            if defect := flaw(rings[0], rings[1:]):  # flown as well without
                (x, y), (line, _) = defect.point_m, part[defect.ring]
                self._warn(line, "field", f"the field is left out: a ring {defect.message} at ({x:g}, {y:g})")
                return None
            outlines.append(rings)
        return Field((), **self._of("site.field")).with_parts(outlines)

    def _paths(self, path_count: int, taken: Collection[str], sets: Mapping[int, Box]) -> tuple[Title, ...]:
        """Names of the path parameters, and what they stand for."""
        line = self._headers.get("paths")
        if line is None:
            return ()
        result: list[Title] = []
        for part in line.split(","):
            head, equals, _ = part.text.partition("=")
            name, unit = named_unit(head)
            if not name or _RESERVED.match(name) or name in [*taken, *(title.name for title in result)]:
                expected = "names like spacing, spacing [m] = 150 - 2*sqrt(4900 + c1)"
                self._fault(part, "a path parameter without a name of its own", expected)
                return ()
            own, formula = f"c{len(result) + 1}", part.part(len(head) + 1)
            stands_for = self._expression(formula) if equals else None
            boxes = [draft.sets[len(result)] for draft in self._drafts if len(draft.sets) > len(result)]
            boxes += [sets.get(len(result) + 1)]
            if stands_for is not None and stands_for.names != {own}:
                self._fault(formula, f"{name} is no expression in {own} alone", f"one, as in 2*sqrt({own})")
            elif stands_for is not None and not all(_is_monotonic(stands_for, own, box) for box in boxes if box):
                self._fault(formula, f"{name} neither rises nor falls over all of the set of {own}", "one that does")
            result.append(Title(name, unit, stands_for))
        if len(result) != path_count:
            expected = "a name for each parameter that a path, a trigger or a shift names"
            self._fault(line, f"{len(result)} names for {path_count} path parameters", expected)
        return tuple(result)

    # --- from drafts to a plan

    def _finish_stages(self) -> None:
        """What needs all stages: the coordinates' values, and checks."""
        for group in self._groups:
            self._read_definitions(group)
        if self._commands:
            self._fault(_Line(len(self._source.lines), "", 1), "a command after the last stage", "a stage after it")
        for index, draft in enumerate(self._drafts, 1):
            if draft.trigger_line is None:
                expected = f"the trigger of stage {index} on the next line, like -115, 146"
                self._fault(draft.line, f"stage {index} has no trigger", expected)
            elif draft.set_lines and draft.set_lines[0].number < draft.trigger_line.number:
                what = f"a set before the trigger of stage {index}"
                self._fault(draft.set_lines[0], what, "its trigger, like -115, 146")
        if not self._drafts:
            return
        self._check_set_counts()
        if self._groups:
            self._check_sections()

    def _check_set_counts(self) -> None:
        first = len(self._drafts[0].sets)
        for index, draft in enumerate(self._drafts, 1):
            if len(draft.sets) != first:
                place = draft.set_lines[-1] if draft.set_lines else draft.line
                message = f"stage {index} has {len(draft.sets)} sets where stage 1 has {first}"
                self._fault(place, message, "the same number of sets in every stage")

    def _check_sections(self) -> None:
        for group, drafts in self._group_drafts():
            if group.n is not None and group.n[0] != len(drafts):
                stages, line = group.n
                self._fault(line, f"n = {stages} where {len(drafts)} stages follow", f"n = {len(drafts)}")
            elif not drafts and not self._faults:
                self._fault(group.line, "a segment without stages", "a section path: with some")
        if len(self._groups) == 1 and not self._groups[0].until:
            if self._groups[0].final is None and not self._faults:
                self._fault(_Line(len(self._source.lines), "", 1), "no final point", "a section trig: with one")
            if not self._groups[0].coordinates and not self._faults:
                what = "a section path: without coordinates"
                self._fault(self._drafts[0].line, what, "a section init: that names some")
            return
        for group in self._groups:
            if group.init and group.until is None and not self._faults:
                place = group.final_line if group.final else group.line
                self._fault(place, "laps that do not end on a condition", "a section trig: like s >= 90")
            elif group.final is not None:
                self._fault(group.final_line, "a final point of a segment that is flown once", "no section trig:")
        last = self._groups[-1]
        if last.until is not None and not self._faults:
            what = "the plan ends with laps that end on a condition"
            self._fault(last.final_line, what, "a section path: after it, whose last trigger is the final point")

    def _group_drafts(self) -> Iterator[tuple[_Group, list[_Draft]]]:
        """Each segment with its stages."""
        ends = [group.drafts for group in self._groups[1:]] + [len(self._drafts)]
        for group, end in zip(self._groups, ends, strict=True):
            yield group, self._drafts[group.drafts : end]

    def _assembled(self) -> Plan:
        count = len(self._drafts[0].sets)
        path_count = max((part.max_parameter for _, part, _ in self._named()), default=0)
        sets: Mapping[int, Box] = self._values.get("sets", {})
        if sets and count:
            self._fault(self._headers["sets"], "a header sets beside stages that carry sets", "one or the other")
        elif sets:
            count = max(sets)
            missing = [f"c{i}" for i in range(1, max(count, path_count) + 1) if i not in sets]
            if missing:
                self._fault(self._headers["sets"], f"no set for {', '.join(missing)}", "a set for every parameter")
                refuse(self._faults)
        if count:
            self._check_indices(count)
        computations = self._values.get("computations", ())
        if count >= path_count and count and computations and len(computations) != count - path_count:
            message = f"{len(computations)} names for {count - path_count} computations"
            self._fault(self._headers["computations"], message, "a name for each set after the paths'")
        taken = {name for name, _ in computations}
        if clash := sorted(taken.intersection(f"c{i}" for i in range(1, path_count + 1))):
            message = f"the computation {clash[0]} has the name of a path parameter"
            self._fault(self._headers["computations"], message, "another name")
        titles = self._paths(path_count, taken, sets)
        self._check_computation_sets(path_count, sets)
        refuse(self._faults)
        boxes = tuple(sets[i] for i in sorted(sets))
        parts = self._parts()
        stages = tuple(self._stage(index, draft, boxes, parts) for index, draft in enumerate(self._drafts, 1))
        plan = Plan(
            name=self._source.name,
            stages=stages,
            path_count=path_count,
            titles=titles,
            site=self._site(),
            header_shift=self._header_shift,
            segments=parts,
            **self._of(""),
        )
        self._check_smoothness(plan)
        if parts:
            counts = {part.count for part in parts if part.repeats}
            plan = replace(plan, primitive_stages=counts.pop() if len(counts) == 1 else None)
        elif self._groups:
            plan = self._repeating(plan)
        elif found := find_structure(plan):
            plan = replace(plan, primitive_stages=found[0], shift=found[1])
        self._compare_header(plan)
        return plan

    def _parts(self) -> tuple[Segment, ...]:
        """The segments of a plan; none of the papers' short form."""
        if not self._groups or (len(self._groups) == 1 and not self._groups[0].until):
            return ()
        parts = []
        for group, drafts in self._group_drafts():
            named = group.coordinates.items()
            variables = tuple(LoopVariable(name, first, shift) for name, (first, shift, _) in named)
            parts.append(Segment(group.drafts, len(drafts), variables, group.until))
        return tuple(parts)

    def _compare_header(self, plan: Plan) -> None:
        """A warning where the shift on the first line is neither that of the stages nor its opposite."""
        if plan.header_shift is None or plan.shift is None or shifts_agree(plan.header_shift, plan.shift):
            return
        stated, found = point_text(plan.header_shift), point_text(plan.shift)
        message = f"the shift ({stated}) is neither what the stages do, ({found}), nor its opposite"
        self._warn(self._header_shift_line, "header-shift", message)

    def _stage(self, index: int, draft: _Draft, boxes: tuple[Box, ...], parts: tuple[Segment, ...]) -> Stage:
        assert draft.gain is not None
        assert draft.rotation in ROTATIONS
        own = tuple(box for box in draft.sets if box is not None)
        firsts = {} if parts else {name: first for name, first, _ in self._short_form_coordinates()}
        path, trigger = self._placed(draft, firsts)
        part = next((part for part in parts if part.first < index <= part.first + part.count), None)
        place = index, draft.line.number, draft.gain, draft.rotation
        return Stage(*place, path, trigger, own or boxes, part, draft.radius_m, **draft.flown)

    def _short_form_coordinates(self) -> list[tuple[str, Expression, Expression]]:
        """Name, first value and shift of the coordinates of the short form; none without sections."""
        table = self._groups[0].coordinates if self._groups else {}
        return [(name, first, shift) for name, (first, shift, _) in table.items() if shift is not None]

    def _placed(self, draft: _Draft, values: Mapping[str, Expression]) -> tuple[Expression, PointExpression]:
        """A stage's path and trigger with its coordinates substituted."""
        assert draft.path is not None
        assert draft.trigger is not None
        if not values:
            return draft.path, draft.trigger
        parts = zip((draft.path, *draft.trigger), (draft.path_line, *[draft.trigger_line or _START] * 2), strict=True)
        placed = []
        for part, line in parts:
            try:
                placed.append(substituted(part, values))
            except ExpressionError as error:
                self._fault(line, error.message, error.expected, error.offset)
                refuse(self._faults)
        return placed[0], (placed[1], placed[2])

    def _named(self) -> Iterator[tuple[str, Expression, _Line]]:
        """Every expression that may name a parameter: what it belongs to, and where it stands."""
        for group in self._groups:
            for name, (first, shift, line) in group.coordinates.items():
                yield from ((f"the coordinate {name}", value, line) for value in (first, shift) if value)
            yield from (("the final point", value, group.final_line) for value in group.final or ())
            yield from (("the end of the laps", value, group.final_line) for value in group.until or ())
        for index, draft in enumerate(self._drafts, 1):
            if draft.path:
                yield f"stage {index}", draft.path, draft.path_line
            yield from ((f"stage {index}", value, draft.trigger_line or _START) for value in draft.trigger or ())
        yield from (("the shift", value, self._header_shift_line) for value in self._header_shift or ())

    def _check_indices(self, count: int) -> None:
        """An index without a set is an error at the expression that names it."""
        for who, part, line in self._named():
            if part.max_parameter > count:
                name = f"c{part.max_parameter}"
                message = f"{who} names {name} where stages have {count} sets"
                self._fault(line, message, f"a set for {name}", part.offsets.get(name, 0))

    def _check_computation_sets(self, path_count: int, header_sets: Mapping[int, Box]) -> None:
        for draft in self._drafts:
            for i, (box, line) in enumerate(zip(draft.sets, draft.set_lines, strict=True)):
                if i >= path_count and box is not None and box.lo < 0:
                    self._fault(line, f"a computation's set that starts at {number_text(box.lo)}", "0 or more")
        for i, box in header_sets.items():
            if i > path_count and box.lo < 0:
                message = f"the set of computation c{i} starts at {number_text(box.lo)}"
                self._fault(self._headers["sets"], message, "0 or more")

    def _check_smoothness(self, plan: Plan) -> None:
        for stage, draft in zip(plan.stages, self._drafts, strict=True):
            if used := stage.path.non_smooth:
                message = f"the path of stage {stage.index} uses {used}, which is not twice differentiable everywhere"
                self._warn(draft.path_line, "not-smooth", message, stage.index)

    def _repeating(self, plan: Plan) -> Plan:
        """The short form: lap 1's stages, and the shift d that takes them to the next lap.

        d is the change of each trigger when every coordinate moves by its shift; all must agree, and so must the paths
        (letter, Eq. 2).
        """
        coordinates = self._short_form_coordinates()
        moved = {name: total(first, shift) for name, first, shift in coordinates}
        shift: PointExpression | None = None
        for stage, draft in zip(plan.stages, self._drafts, strict=True):
            path, trigger = self._placed(draft, moved)
            d = (difference(trigger[0], stage.trigger[0]), difference(trigger[1], stage.trigger[1]))
            if shift is None:
                shift = (tidy(d[0]), tidy(d[1]))
            expected = f"a shift of ({point_text(shift)})"
            if not (equal(d[0], shift[0]) and equal(d[1], shift[1])):
                message = f"the trigger of stage {stage.index} does not shift as that of stage 1 does"
                self._fault(draft.trigger_line or _START, message, expected)
            elif not moves_with(shift, stage.path, path):
                message = f"the path of stage {stage.index} does not shift as its trigger does"
                self._fault(draft.path_line, message, expected)
        if shift is not None and all(not part.names and part.value({}) == 0 for part in shift):
            self._fault(_Line(self._drafts[0].line.number, "", 1), "a plan that repeats without a shift", "a shift")
        stages = tuple((draft.path, draft.trigger) for draft in self._drafts if draft.path and draft.trigger)
        final, form = self._groups[0].final, ShortForm(tuple(coordinates), stages)
        return replace(plan, repeats=True, shift=shift, final=final, primitive_stages=len(stages), short_form=form)

    # --- reading parts of a line, faults recorded

    def _fault(self, line: _Line, message: str, expected: str = "", offset: int = 0) -> None:
        self._faults.append(self._source.fault((line.number, line.column + offset), message, expected))

    def _warn(self, line: _Line, code: str, message: str, stage: int | None = None) -> None:
        self._findings.append(Finding("warning", stage, line.number, code, message, line.column))

    def _attempt(self, line: _Line, read: Callable[[str], T], expected: str = "") -> T | None:
        try:
            return read(line.text)
        except ExpressionError as error:
            what = f"{error.expected} ({expected})" if expected and error.expected else expected or error.expected
            self._fault(line, error.message, what, error.offset)
            return None

    def _expression(self, line: _Line) -> Expression | None:
        return self._attempt(line, partial(read_expression, names=self._coordinates))

    def _point(self, line: _Line, expected: str) -> PointExpression | None:
        pair = self._attempt(line, partial(read_expressions, names=self._coordinates, count=2), expected)
        free = pair is not None and self._is_free(line, pair, "a point", "numbers and parameters")
        return (pair[0], pair[1]) if pair and free else None

    def _is_free(self, line: _Line, parts: Sequence[Expression], what: str, expected: str) -> bool:
        """Whether expressions do not depend on x or y; else the first that does is a fault."""
        for part, name in itertools.product(parts, ("x", "y")):
            if name in part.offsets:
                self._fault(line, f"{what} that depends on {name}", expected, part.offsets[name])
                return False
        return True

    def _number(self, line: _Line, expected: str, valid: Callable[[float], bool]) -> float | None:
        return self._attempt(line, partial(read_number, expected=expected, valid=valid))


def _is_monotonic(expression: Expression, name: str, box: Box) -> bool:
    """Whether an expression in one parameter is defined, and strictly rises or falls, at a hundred steps of a set."""
    if box.fixed:
        return True
    try:
        values = [expression.value({name: box.lo + (box.hi - box.lo) * i / 100}) for i in range(101)]
    except PathUndefined:
        return False
    steps = [later - first for first, later in itertools.pairwise(values)]
    return all(step > 0 for step in steps) or all(step < 0 for step in steps)


_NOWHERE: PointExpression = (constant(0.0), constant(0.0))


def _second_comma(text: str) -> int | None:
    """Where the comma before the third of some values stands, commas in brackets left out; None without."""
    depth, commas = 0, []
    for i, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if character == "," and depth == 0:
            commas.append(i)
    return commas[1] if len(commas) > 1 else None
