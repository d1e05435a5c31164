"""Plan text: the papers' format and its dialects, canonical text, and whatever else may come."""

import contextlib
import math
from dataclasses import replace
from functools import partial

import pytest
from common import ROOT
from common.answers import faults_by
from common.plans import APPENDIX_RIGHT, PARTS, SHORT, WAVES
from common.plans import plan_of as read
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import constant
from eadp.errors import InputError
from eadp.io.plan.reader import LIMIT_STAGES, read_plan
from eadp.io.plan.sources import PlanReader
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text, read_text
from eadp.models.airspace import Airspace, Obstacle
from eadp.models.plan.plan import Plan, Site
from eadp.models.plan.stage import COMPUTATION, PATH, Box, Stage

NANOMETRE = 1e-9

TWO = "0.05; 270; x+115\n-115, 11\n0.0003; 90; (x+40)^2+(y-11)^2-5625\n35, 11\n"


faults_of = partial(faults_by, read)


def findings_of(body):
    return read_plan(Text("p", body))[1]


def anywhere(plan: Plan) -> Plan:
    """A plan without where it was read from."""
    return replace(plan, name="", stages=tuple(replace(stage, line=0) for stage in plan.stages))


def same(one: Plan, other: Plan) -> bool:
    return anywhere(one) == anywhere(other)


def triggers(plan, *parameters):
    return [stage.trigger_at(parameters) for stage in plan.stages]


# --- the papers' format -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Mast height 30", "height 5", "mast"])
def test_an_obstacle_whose_name_ends_as_a_height_does_keeps_its_own(name):
    plan = read(SHORT)
    for height_m in (None, 12.0):
        mast = Obstacle(((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)), name, height_m)
        with_mast = replace(plan, site=plan.site._replace(airspace=Airspace((mast,))))
        assert read(plan_text(with_mast)).site.airspace.obstacles == (mast,)


def test_the_appendix():
    plan = read(APPENDIX_RIGHT)
    assert [stage.line for stage in plan.stages] == [1, 5, 9, 13, 17]
    assert [stage.index for stage in plan.stages] == [1, 2, 3, 4, 5]
    assert [stage.gain for stage in plan.stages] == [3e-4, 0.05, 3e-4, 0.05, 3e-4]
    assert [stage.rotation_deg for stage in plan.stages] == [90, 270, 90, 90, 90]
    assert [stage.kind for stage in plan.stages] == ["circle", "line", "circle", "line", "circle"]
    assert [stage.sets for stage in plan.stages] == [(Box(-3000, 0), Box(2, 10))] * 4 + [(Box(-3000, 0), Box(0, 0))]
    assert [parameter.kind for parameter in plan.parameters] == [PATH, COMPUTATION]
    assert plan.path_count == 1
    assert plan.trigger_radius_m == 20
    assert not plan.repeats


@pytest.mark.parametrize("c1", [0.0, -1000.0, -2999.0, -3000.0])
def test_the_appendix_as_corrected_is_a_survey(c1):
    plan = read(APPENDIX_RIGHT)
    stages = list(plan.stages)
    for stage, trigger in zip(stages, triggers(plan, c1), strict=True):
        assert stage.path_at((c1,))(*trigger)[0] == pytest.approx(0, abs=1e-9), "each trigger lies on its path"
    for stage, trigger in zip(stages[1:], triggers(plan, c1)[:-1], strict=True):
        off = stage.path_at((c1,))(*trigger)[0]
        assert off == pytest.approx(0, abs=1e-9), "and on the next"


def test_the_shipped_survey():
    plan, findings = read_plan(read_text(str(ROOT / "plans" / "survey.plan")))
    assert not findings
    assert (plan.repeats, plan.primitive_stages, len(plan.stages)) == (True, 4, 4)
    assert plan.parameters[1].title == "fps"
    for c1 in (0.0, -500.0, -1000.0):
        r2 = math.sqrt(4900 + c1)
        assert [part.value({"c1": c1}) for part in plan.shift] == pytest.approx([150 - 2 * r2, (75 - r2) / 5])
        assert triggers(plan, c1) == [(-115, 146), (-115, -11), (35, -11), (35, 146)]
        # as ../spec/07 prints them
        assert plan.stages[0].path_at((c1,))(r2 - 115, 146.0)[0] == pytest.approx(-(4900 + c1))
        assert plan.stages[2].path_at((c1,))(-40.0, 11.0)[0] == -5625


# --- dialects ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        TWO,
        TWO.replace("\n", "\r\n"),
        TWO.replace("\n", "\r"),
        "\ufeff" + TWO,
        "\n\n" + TWO.replace("\n", "\n\n \t\n"),
        "1: 0.05; 270; x+115\n2: -115, 11\n3:0.0003;90;(x+40)^2+(y-11)^2-5625\n4   :35,11\n",
        TWO.replace("270", "1").replace("90", "0"),
        TWO.replace("270", "3*90").replace("90;", "+90 ;"),
        TWO.replace("^", "**"),
        "% a comment\n# another\n" + TWO,
        "1: %\n2: 0.05; 270; x+115\n3: # hm\n4: -115, 11\n" + TWO.split("\n", 2)[2],
        TWO.replace("x+115", "+(x+(100+15))"),
    ],
)
def test_dialects_of_one_plan(text, tmp_path):
    path = tmp_path / "a.plan"
    path.write_bytes(text.encode())
    plan, findings = read_plan(read_text(str(path)))
    wanted = read(TWO)
    assert not findings
    assert [(s.gain, s.rotation_deg, s.kind) for s in plan.stages] == [(0.05, 270, "line"), (3e-4, 90, "circle")]
    for point in ((0.0, 0.0), (10.0, -3.0)):
        for one, other in zip(plan.stages, wanted.stages, strict=True):
            assert one.path_at(())(*point) == other.path_at(())(*point)
    assert triggers(plan) == triggers(wanted)


def test_lines_are_those_of_the_file_whatever_their_numbers():
    plan = read("% a\n\n10: 0.05; 270; x\n% b\n20: 0, 0\n\n30: 1; 1; x\n40: 0, 9\n")
    assert [stage.line for stage in plan.stages] == [3, 7]


@pytest.mark.parametrize("header", ["-10,-1\n", "1: -10 , -1\n", "% c\n-10,-1\n"])
def test_a_shift_before_the_first_stage(header):
    plan = read(header + TWO)
    assert [part.value({}) for part in plan.header_shift] == [-10, -1]
    assert not read(TWO).header_shift


def laps(count, header, dx=10.0, dy=1.0):
    one = "1; 90; x - {0}\n{0}, 100 + {1}\n1; 270; x - {0} - 5\n{0} + 5, {1}\n"
    return f"{header}\n" + "".join(one.format(dx * k, dy * k) for k in range(count))


@pytest.mark.parametrize(
    ("header", "codes"),
    [
        ("-10, -1", []),
        ("10, 1", []),
        ("", []),
        ("-10, 1", ["header-shift"]),
        ("-10, -2", ["header-shift"]),
        ("0, 0", ["header-shift"]),
    ],
)
def test_a_shift_that_disagrees_in_both_signs_is_a_finding(header, codes):
    findings = findings_of(laps(3, header))
    assert [finding.code for finding in findings] == codes
    assert all(finding.severity == "warning" and finding.line == 1 for finding in findings)


def test_sets_in_a_header():
    plan = read("%: sets c1 [-1000,0], c2 [2, 5*2]\n" + TWO.replace("x+115", "x+115+c1"))
    assert [stage.sets for stage in plan.stages] == [(Box(-1000, 0), Box(2, 10))] * 2
    other = read("%: sets c2 [2,10] ,c1 [-1000,0]\n" + TWO.replace("x+115", "x+115+c1"))
    assert other.stages[0].sets == (Box(-1000, 0), Box(2, 10))
    assert same(read(plan_text(plan)), plan)


def test_parameters_of_triggers_count_too():
    plan = read("1; 90; x - c1\nc1, c3\n[0, 1]\n[0, 1]\n[0, 1]\n[0, 1]\n")
    assert plan.path_count == 3
    assert [parameter.kind for parameter in plan.parameters] == [PATH, PATH, PATH, COMPUTATION]


# --- the short form ---------------------------------------------------------------------------------------------------


def test_the_short_form():
    plan = read(SHORT)
    assert (plan.repeats, plan.primitive_stages, plan.path_count) == (True, 4, 1)
    for c1 in (0.0, -700.0):
        d = 150 - 2 * math.sqrt(4900 + c1)
        assert [part.value({"c1": c1}) for part in plan.shift] == pytest.approx([d, 0], abs=NANOMETRE)
        assert triggers(plan, c1) == [(-115, 146), (-115, 0), (35, 0), (35, 146)]
    assert [part.value({}) for part in plan.final_point] == [180, 146]
    assert plan.stages[1].path.text == "x + 115"
    assert [stage.line for stage in plan.stages] == [7, 11, 15, 19]


def test_sections_may_come_in_any_order_but_names_before_their_use():
    head, tail = SHORT.split("trig:\n")
    init, path = head.split("path:\n")
    moved = read(init + "trig:\n" + tail + "path:\n" + path)
    assert same(moved, read(SHORT))
    assert any(
        "unknown name left" in fault
        for fault in faults_of("path:\n" + path + init.replace("%", "#") + "trig:\n" + tail)
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("right = 35, 150 - 2*", "right = 35, 151 - 2*", "the trigger of stage 3 does not shift as that of stage 1"),
        ("(x - left - 75)^2", "(x - left + 0.001*right - 75)^2", "the path of stage 3 does not shift as its trigger"),
        ("(y - 146)^2", "(y - 146 + 0.0001*left)^2", "the path of stage 1 does not shift as its trigger does"),
    ],
)
def test_all_must_shift_alike(old, new, message):
    assert any(message in fault for fault in faults_of(SHORT.replace(old, new)))


def test_a_path_may_change_by_a_constant_from_lap_to_lap():
    # letter, Eq. 2: e_j; here φ grows by 3 each lap
    text = "init:\na = 0, 10\nb = 0, 3\npath:\n1; 90; x - a + b\na, 0\ntrig:\n100, 0\n"
    assert [part.value({}) for part in read(text).shift] == [10, 0]


# --- headers ----------------------------------------------------------------------------------------------------------


def test_headers():
    plan, findings = read_plan(
        Text(
            "p",
            "%: computations fps [1/s], key_size [bit]\n%: trigger-radius 5*3\n  7: %:min-radius 30\n"
            "%: origin 55.37 10.43\n" + TWO.replace("x+115", "x+115+c1"),
        )
    )
    assert not findings
    assert plan.computations == (("fps", "1/s"), ("key_size", "bit"))
    assert (plan.trigger_radius_m, plan.min_radius_m, plan.site.origin_deg) == (15, 30, (55.37, 10.43))
    assert [parameter.name for parameter in plan.parameters] == ["c1", "c2", "c3"]


def test_a_trigger_has_a_radius_of_its_own_or_the_headers():
    plan = read("%: trigger-radius 7\n" + TWO.replace("-115, 11\n", "atan2(-115, 1), 11, 3*10^1\n"))
    assert [stage.radius_m for stage in plan.stages] == [30, None]
    assert [plan.radius_m(stage) for stage in plan.stages] == [30, 7]
    assert plan.final_radius_m == 7


@pytest.mark.parametrize("text", [WAVES, PARTS])
def test_radii_stand_in_sections_too(text):
    heads = [line for line in text.splitlines() if ";" in line]
    lines = text.splitlines()
    for k, head in enumerate(heads, 1):
        lines[lines.index(head) + 1] += f", {k}"
    plan = read("\n".join(lines))
    assert [stage.radius_m for stage in plan.stages] == list(range(1, len(heads) + 1))
    assert same(read(plan_text(plan)), plan)


@pytest.mark.parametrize("radii", [(5, 5), (20, ""), (5, 6)])
def test_found_laps_have_equal_radii(radii):
    one, other = (f", {radius}" if radius else "" for radius in radii)
    plan = read(f"0.1; 90; x\n0, 5{one}\n0.1; 90; x - 10\n10, 5{other}\n")
    assert plan.primitive_stages == 1
    assert plan.whole_laps == (radii != (5, 6))
    assert read("%: origin -33.9, -180\n" + TWO).site.origin_deg == (-33.9, -180)


@pytest.mark.parametrize("place", ["90.1 0", "0 180.1", "55", "north 5", "nan 5"])
def test_what_is_no_origin(place):
    assert "no origin" in faults_of(f"%: origin {place}\n{TWO}")[0]


def test_an_unknown_header_is_a_warning():
    (finding,) = findings_of("1;90;x\n%: colour re\x1bd\n0,0\n")
    assert (finding.severity, finding.line, finding.code) == ("warning", 2, "unknown-header")
    assert finding.message.startswith("unknown header colour")


def test_a_path_that_is_not_smooth_is_a_warning():
    findings = findings_of("1; 90; abs(x)-3\n3, 0\n1; 90; y\n0, 0\n1; 90; max(x, y^2, min(x, y))\n0, 0\n")
    assert [(finding.code, finding.stage, finding.line, finding.severity) for finding in findings] == [
        ("not-smooth", 1, 1, "warning"),
        ("not-smooth", 3, 5, "warning"),
    ]
    assert "uses abs" in findings[0].message
    assert not findings_of("1; 90; x\nabs(-3), max(1, 2)\n"), "a point may"


# --- canonical text ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [TWO, APPENDIX_RIGHT, SHORT, laps(3, "-10, -1"), laps(2, "")])
def test_canonical_text_reads_as_the_same_plan(text):
    plan = read(text)
    printed = plan_text(plan)
    assert same(read(printed), plan)
    assert plan_text(read(printed)) == printed


def test_canonical_text_of_the_short_form_is_the_short_form():
    assert plan_text(read(SHORT)) == SHORT.replace("75^2", "75^2")
    loose = SHORT.replace(" = ", "=").replace("; ", ";").replace(" - ", "-").replace("0.006", "6e-3")
    assert plan_text(read(loose)) == SHORT


numbers = st.one_of(st.integers(-(10**6), 10**6).map(float), st.floats(-1e9, 1e9))
paths = st.sampled_from(
    ["x", "x + c1", "(x - 3)^2 + (y + 2)^2 - 4900 - c1", "-(x^2) + sin(y)/c2", "x^-2^c1", "x*y - --y"]
)
radii = st.none() | st.floats(1e-3, 1e6)
boxes = st.tuples(st.floats(0, 1e9), st.floats(0, 1e9)).map(lambda pair: Box(*sorted(pair)))
words = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,8}", fullmatch=True)
units = st.one_of(st.just(""), st.from_regex(r"[a-z/%0-9]{1,4}", fullmatch=True))


near = st.floats(-7e4, 7e4)
"""Coordinates of a plan with an origin [m]."""


@st.composite
def plans(draw):
    count = draw(st.integers(1, 4))
    origin = draw(st.one_of(st.none(), st.tuples(st.floats(-90, 90), st.floats(-180, 180))))
    metres = numbers if origin is None else near
    per_stage = draw(st.integers(0, 4))
    texts = [draw(paths) for _ in range(count)]
    path_count = max(read_expression(text).max_parameter for text in texts)
    if per_stage:
        per_stage = max(per_stage, path_count)
    computations = ()
    free = per_stage - path_count if per_stage else draw(st.integers(0, 2))
    if free and draw(st.booleans()):
        names = draw(st.lists(words, min_size=free, max_size=free, unique=True))
        computations = tuple((name, draw(units)) for name in names)
    stages = tuple(
        Stage(
            index, 0, abs(draw(numbers)), draw(st.sampled_from([90, 270])), read_expression(text),
            (constant(draw(metres)), constant(draw(metres))), tuple(draw(boxes) for _ in range(per_stage)),
            radius_m=draw(radii),
        )
        for index, text in enumerate(texts, 1)
    )  # fmt: skip
    shift = draw(st.one_of(st.none(), st.tuples(numbers, numbers)))
    return Plan(
        "", stages, path_count, computations, trigger_radius_m=draw(st.one_of(st.just(20.0), st.floats(1e-3, 1e6))),
        min_radius_m=draw(radii), site=Site(origin), header_shift=shift and tuple(map(constant, shift)),
    )  # fmt: skip


@given(plans())
def test_any_plan_is_read_as_it_was_written(plan):
    again = anywhere(read(plan_text(plan)))
    found = replace(plan, primitive_stages=again.primitive_stages, shift=again.shift)  # what its stages happen to do
    assert again == found


# --- every fault at once ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    ["\n" * 200_000 + TWO, "init:\nn = 1\n" + " " * 200_000 + "\n", "%: made-for a" + " " * 200_000 + "b\n" + TWO],
    ids=["blank lines", "a blank line", "made-for"],
)
def test_blanks_take_time_with_their_number(text):
    """Each would take a minute or more where time grew with the square of the number."""
    with contextlib.suppress(InputError):
        PlanReader()(Text("p", text))


def test_all_the_faults_of_a_file_first_by_line():
    text = "0.05; 271; x+115\n-115\n-1; 90; 2*radius\n35, 11\n[10, 2]\n1; 90; x; y\n0, 0\n[1, 2]\n"
    said = [fault.split(";")[0] for fault in faults_of(text)]
    assert said == [
        "p:1:7: error: 271 cannot stand here",
        "p:2:5: error: 1 of 2 values",
        "p:3:1: error: -1 cannot stand here",
        "p:3:11: error: unknown name radius",
        "p:5:1: error: a set whose lower bound 10 is above its upper bound 2",
        "p:5:1: error: stage 2 has 1 sets where stage 1 has 0",
        "p:6:1: error: a stage with 4 parts between semicolons",
        "p:8:1: error: stage 3 has 1 sets where stage 1 has 0",
    ]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("%: trigger-radius 20\n%: trigger-radius 15\n" + TWO, "p:2:4:"),
        ("%: sets c2 [2, 10]\n1; 90; x - c1\n0, 0\n", "p:1:9:"),
        ("%: computations fps, k\n1; 90; x\n0, 0\n[1, 2]\n", "p:1:17:"),
        ("1; 90; " + "x" * 10_001 + "\n0, 0\n", "p:1:8:"),
        (SHORT.replace("x - left\n", "x^3 - left\n"), "p:11:11:"),
    ],
)
def test_places_are_those_of_the_first_character(text, place):
    assert faults_of(text)[0].startswith(place)


@pytest.mark.parametrize(
    "text",
    [
        "1; 90; x\n[0, 1]\n0, 0\n",  # the trigger behind a set: not a second one
        SHORT.replace("left = -115, 150", "left = -115 150"),  # not an unknown name in every stage
        SHORT.replace("left = -115", "left = -115 + x"),
    ],
)
def test_one_mistake_is_one_fault(text):
    assert len(faults_of(text)) == 1


def test_columns_count_from_1_in_the_line_as_it_stands():
    (said,) = faults_of("  12 :  0.05;  270;   x + radius\n-115, 11\n")
    assert said.startswith("p:1:27: error: unknown name radius")
    (said,) = faults_of("%: x\n0.05; 270; x\n-115,   y\n")
    assert said == "p:3:9: error: a point that depends on y; expected numbers and parameters"


def test_the_line_is_quoted_with_a_caret_and_without_control_characters():
    with pytest.raises(InputError) as caught:
        read("0.05; 270;\tx + \x1b\n0, 0\n")
    (fault,) = caught.value.faults
    head, line, caret = str(fault).split("\n")
    assert head == "p:1:16: error: unexpected character '\\x1b'; expected an expression"
    assert line == "    0.05; 270;\\tx + \\x1b"
    assert caret.index("^") == line.index("\\x1b")


def test_a_long_line_is_cut_round_its_fault():
    with pytest.raises(InputError) as caught:
        read("1; 90; " + "x + " * 1000 + "radius + " + "x + " * 1000 + "x\n0, 0\n")
    _, line, caret = str(caught.value.faults[0]).split("\n")
    assert len(line) <= 104
    assert line[caret.index("^") :].startswith("radius")


# --- whatever comes ---------------------------------------------------------------------------------------------------


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from([TWO, APPENDIX_RIGHT, SHORT]), st.data())
def test_a_plan_that_is_tampered_with_is_read_or_refused(text, data):
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        dropped = data.draw(st.integers(0, 5))
        inserted = data.draw(st.one_of(st.text(max_size=2), st.text("0129.;,:[]()xyc^*/+- \n%", max_size=4)))
        text = text[:at] + inserted + text[at + dropped :]
    read_or_refuse(text)


def well_placed(faults, lines):
    for fault in faults:
        assert 1 <= fault.line <= len(lines)
        assert 1 <= fault.column <= len(lines[fault.line - 1]) + 1
        assert all(line.isprintable() for line in str(fault).split("\n"))
    assert list(faults) == sorted(faults, key=lambda fault: (fault.line, fault.column))


def read_or_refuse(text):
    try:
        plan, findings = read_plan(Text("p", text))
    except InputError as error:
        well_placed(error.faults, text.split("\n"))
        return
    for finding in findings:
        assert finding.message.isprintable()
    printed = plan_text(plan)
    if max(map(len, printed.split("\n"))) < 9_000:  # else what the canonical text adds may exceed the limit
        assert same(read(printed), plan)


@pytest.mark.parametrize("path", ["x - a - 1/(a - 5)", "x - a - sqrt(-a)", "x - a - 9^9^a", "x - a - y*0*exp(a^5)"])
def test_constants_that_coordinates_make_are_checked(path):
    assert faults_of(f"init:\na = 5, 1\npath:\n1; 90; {path}\na, 0\ntrig:\n9, 9\n")


@pytest.mark.slow
def test_a_plan_that_is_too_long():
    stage = "0.05; 90; y\n30, 0\n"
    assert len(read_plan(Text("a.plan", stage * LIMIT_STAGES))[0].stages) == LIMIT_STAGES
    line = 2 * LIMIT_STAGES + 1
    with pytest.raises(InputError, match=f"a.plan:{line}:1: error: more than {LIMIT_STAGES} stages"):
        read_plan(Text("a.plan", stage * (LIMIT_STAGES + 100)))


def test_headers_of_stages_hold_from_the_next_stage_on_and_are_written_back():
    text = (
        "%: start -5 12.5\n%: altitude 60\n%: command 206 25 0 1 0 0 0 0\n0.1; 90; x\n0, 100\n"
        "%: airspeed 18\n0.1; 90; x\n0, 200\n%: altitude 90\n%: command 530 0 2 0 0 0 0 0\n0.1; 90; x\n0, 300\n"
        "%: altitude default\n%: airspeed default\n0.1; 90; x\n0, 400\n"
    )
    plan, findings = read_plan(Text("p", text))
    assert findings == []
    assert plan.site.start_m == (-5, 12.5)
    assert [stage.altitude_m for stage in plan.stages] == [60, 60, 90, None]
    assert [stage.airspeed_mps for stage in plan.stages] == [None, 18, 18, None]
    assert [[command[0] for command in stage.commands] for stage in plan.stages] == [[206], [], [530], []]
    written = plan_text(plan)
    again, _ = read_plan(Text("p", written))
    assert plan_text(again) == written
    assert written.count("%: altitude") == 3
    # stages that differ in altitude are no laps
    assert not plan.whole_laps


@pytest.mark.parametrize(
    ("header", "camera"),
    [
        ("Sony a6000 20 mm altitude 102.1 gsd 2", ("Sony a6000 20 mm", 102.1, 2.0)),
        ("altitude 80", ("", 80.0, None)),
        ("one with an altitude 5 altitude 80 gsd 1.25", ("one with an altitude 5", 80.0, 1.25)),
    ],
)
def test_the_camera_comes_back(header, camera):
    text = f"%: camera {header}\n0.05; 270; x+115\n-115, 11\n"
    plan, findings = read_plan(Text("given", text))
    assert plan.site.camera == camera
    assert findings == []
    assert read_plan(Text("again", plan_text(plan)))[0].site.camera == camera


@pytest.mark.parametrize("header", ["Sony", "altitude high", "altitude nan", "altitude 80 gsd -1"])
def test_a_camera_without_an_altitude_is_none(header):
    with pytest.raises(InputError, match="1:11: error: no camera, altitude and pixel size"):
        read_plan(Text("given", f"%: camera {header}\n0.05; 270; x+115\n-115, 11\n"))
