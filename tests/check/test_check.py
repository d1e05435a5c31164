"""Faults put into sound plans, each found with its size; sound plans without a finding."""

import math

import pytest
from common.plans import APPENDIX_PRINTED, APPENDIX_RIGHT, PARTS
from hypothesis import given
from hypothesis import strategies as st

from eadp.check.check import check_plan, laps_proven
from eadp.check.proof import StageProof
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text


def plan(text):
    return read_plan(Text("p", text))[0]


def checked(text, **options):
    return check_plan(plan(text), **options)


def codes(report, severity=None):
    return [item.code for item in report.findings if severity in (None, item.severity)]


def test_published_plans_are_sound(reference):
    report = checked(APPENDIX_RIGHT)
    assert codes(report) == []
    assert report.valid
    found = read_plan(read_text(str(reference / "plans/plan_specification.pln")))[0]
    assert check_plan(found).findings == ()


def test_the_appendix_as_printed_is_caught():
    report = checked(APPENDIX_PRINTED)
    first = report.findings[0]
    assert (first.severity, first.code, first.stage, first.line) == ("error", "trigger-off-path", 1, 1)
    # radius √(4900 + 3000) of the circle, √(4900 − 3000) of the trigger
    assert f"{math.sqrt(7900) - math.sqrt(1900):.2f} m" in first.message
    assert "c1 = -3000" in first.message


def test_the_survey_as_published_has_warnings_only(root):
    report = check_plan(read_plan(read_text(str(root / "plans/survey.plan")))[0])
    assert not report.has_errors
    assert report.valid
    messages = [item.message for item in report.findings if item.stage in (2, 3)]
    assert sum("3.16 m" in message for message in messages) == 2
    assert sum("16.3° apart" in message for message in messages) == 2
    assert math.hypot(75, 22) - 75 == pytest.approx(3.16, abs=0.005), "by hand"
    assert math.degrees(math.atan2(22, 75)) == pytest.approx(16.35, abs=0.005), "by hand"


SOUND = ["0.1; 90; x\n0, 200\n", "0.006; 90; (x+75)^2+(y-200)^2-75^2\n-150, 200\n", "0.1; 270; x+150\n-150, 0\n"]


def test_a_sound_plan_has_no_finding():
    report = checked("".join(SOUND))
    assert report.findings == ()
    assert report.witness == ((), (), ())


def broken(index, old, new):
    lines = list(SOUND)
    assert old in lines[index]
    lines[index] = lines[index].replace(old, new)
    return "".join(lines)


@pytest.mark.parametrize(
    ("text", "expected", "size"),
    [
        (broken(0, "0, 200", "5, 200"), {("warning", "trigger-off-path"), ("warning", "trigger-off-next")}, "5.00 m"),
        (broken(0, "0, 200", "30, 200"), {("error", "trigger-off-path"), ("error", "trigger-off-next")}, "30.00 m"),
        (broken(1, "-75^2", "-70^2"), {("warning", "trigger-off-path"), ("warning", "trigger-off-next")}, "5.00 m"),
        (broken(1, "; 90;", "; 270;"), {("error", "direction")}, "180.0° apart"),
        (broken(2, "; 270;", "; 90;"), {("error", "direction"), ("error", "behind")}, "200.00 m behind"),
        (broken(2, "-150, 0", "-150, 300"), {("error", "behind")}, "100.00 m behind"),
        (broken(2, "-150, 0", "-150, 190"), {("warning", "short-stage")}, "10.00 m long"),
        (broken(1, "-75^2", "+75^2"), {("error", "no-path")}, "radius² is -5625"),
    ],
)
def test_one_fault_one_finding(text, expected, size):
    report = checked(text)
    assert expected <= {(item.severity, item.code) for item in report.findings}
    assert any(size in item.message for item in report.findings)
    assert report.has_errors == any(severity == "error" for severity, _ in expected)


def test_thresholds_are_where_they_are_said_to_be():
    for gap, severity in ((0.9e-3, None), (1.1e-3, "warning"), (19.9, "warning"), (20.1, "error")):
        report = checked(f"0.1; 90; x\n{gap}, 200\n0.1; 90; x\n0, 500\n")
        assert {item.severity for item in report.findings if item.code == "trigger-off-path"} == (
            {severity} if severity else set()
        )
    for turn, severity in ((0.09, None), (0.11, "warning"), (44.9, "warning"), (45.1, "error")):
        slope = math.tan(math.radians(turn))
        report = checked(f"0.1; 90; x\n0, 200\n0.1; 90; x-{slope!r}*(200-y)\n{slope * -300!r}, 500\n")
        assert codes(report, severity) == (["direction"] if severity else [])


def test_a_radius_only_where_one_is_given():
    text = "".join(SOUND)
    assert codes(checked(text, min_radius_m=75.0)) == []
    report = checked(text, min_radius_m=80.0)
    assert codes(report, "error") == ["radius"]
    assert "75.00 m, 5.00 m less" in report.findings[0].message
    assert codes(checked("%: min-radius 80\n" + text)) == ["radius"]


def test_the_worst_point_inside_the_range_is_found():
    """A trigger that is off its line by a bump inside the range, and on it at both ends."""
    bump = "10*exp(-((c1 - 37)/90)^2)"
    report = checked(f"0.1; 90; x\n{bump}, 200\n[-1000, 1000]\n0.1; 90; x\n0, 500\n[-1000, 1000]\n")
    message = next(item for item in report.findings if item.code == "trigger-off-path").message
    assert float(message.split(" lies ")[1].split(" m")[0]) == pytest.approx(10, abs=0.2)
    assert float(message.split("c1 = ")[1].rstrip(")")) == pytest.approx(37, abs=16)


def test_validity_is_shown_by_a_parameter_value():
    """A trigger that is on the next path only for c1 = 40 of [0, 80]."""
    text = "0.1; 90; x - c1\nc1, 200\n[0, 80]\n0.1; 90; x - 40\n40, 500\n[0, 80]\n"
    report = checked(text)
    assert report.has_errors, "at the ends it is 40 m off"
    assert report.valid
    assert report.witness[0] == pytest.approx((40,), abs=1e-3)
    assert not checked(text.replace("x - 40", "x - 140").replace("\n40, 500", "\n140, 500")).valid


def test_what_is_found_by_value_against_a_proof_is_not_proven():
    found = check_plan(plan(broken(0, "0, 200", "5, 200")), proofs=[StageProof("0", "0", True)] * 3).findings
    assert [(item.formula, item.proven) for item in found] == [("", False)] * 2


@given(
    st.floats(-500, 500),
    st.floats(-500, 500),
    st.floats(20, 200),
    st.floats(0, 360),
    st.floats(20, 300),
    st.sampled_from([90, 270]),
)
def test_generated_tangent_plans_have_no_finding(x, y, radius, angle, sweep, rotation):
    """A circle from one angle through another, then the line that leaves it: sound by construction, turned anyhow."""
    turn = 1 if rotation == 90 else -1
    start, end = math.radians(angle), math.radians(angle + turn * sweep)

    def on_circle(a):
        return x + radius * math.cos(a), y + radius * math.sin(a)

    def line(a, along):
        px, py = on_circle(a)
        tx, ty = -turn * math.sin(a), turn * math.cos(a)
        nx, ny = math.cos(a), math.sin(a)  # rotation 90 travels along (−ny, nx)
        return f"({nx!r})*(x-({px!r}))+({ny!r})*(y-({py!r}))", (px + along * tx, py + along * ty)

    before, join = line(start, 0.0)
    after, final = line(end, 300.0)
    centre = f"(x-({x!r}))^2+(y-({y!r}))^2-{radius!r}^2"
    stages = [(before, join), (centre, on_circle(end)), (after, final)]
    text = "".join(f"0.1; {rotation}; {path}\n{point[0]!r}, {point[1]!r}\n" for path, point in stages)
    report = checked("%: trigger-radius 5\n" + text)
    assert [item for item in report.findings if item.code != "short-stage"] == []


def many(count, trigger, sets="[0, 8]\n"):
    """Two lines that `count` parameters move; the second's trigger is off it by what is given."""
    total = "+".join(f"c{i}" for i in range(1, count + 1))
    lines = [f"0.1; 90; x - ({total})", f"{total}, 200\n" + sets * count]
    return "\n".join([*lines, f"0.1; 90; x - ({total})", f"{total} + {trigger}, 500\n" + sets * count])


@pytest.mark.quick(1)
@pytest.mark.parametrize("count", [9, 24, 999])
def test_of_many_parameters_corners_are_sampled(count):
    report = checked(many(count, "c1 - c2"))
    message = next(item.message for item in report.findings if item.code == "trigger-off-path")
    assert "8.00 m" in message


@pytest.mark.slow
def test_findings_name_parameters_that_only_a_loop_variable_depends_on():
    text = PARTS.replace("10 + s + 114, top", "10 + s + 114 - c1/100, top")
    message = next(item.message for item in checked(text).findings if item.code == "trigger-off-path")
    assert "c1 = -900" in message
    text = PARTS.replace("10 + next, 0", "11 + next, 0")
    assert "(at c1 = " in next(item.message for item in checked(text).findings if item.code == "trigger-off-path")


def test_laps_are_proven_alike_where_they_are(root, reference):
    for path in (reference / "plans/plan_specification.pln", root / "plans/survey.plan"):
        assert laps_proven(read_plan(read_text(str(path)))[0])
    text = "0.1; 90; {first}\n1 - c1, 100\n[0, 5]\n0.1; 90; {second}\n2 + c1*(c1 + 3) - c1^2 - 4*c1, 100\n[0, 5]\n"
    assert laps_proven(plan(text.format(first="x - 1 + c1", second="x + c1 - 2")))
    # by less than sampling sees
    found = plan(text.format(first="x - 1 + c1", second="x + c1 - 2 + 1e-12"))
    assert found.primitive_stages == 1
    assert not laps_proven(found)


def test_laps_of_the_short_form_are_alike_in_every_lap():
    text = "init:\nn = 1\na = 0, 10\npath:\n0.1; 90; {path}\na, 100\ntrig:\n100, 100\n"
    assert laps_proven(plan(text.format(path="x - a")))
    # the second lap's line is the first one's moved, the third one's is not
    later = plan(text.format(path="x - a*(1 + a*(a - 10)/1000)"))
    assert later.repeats
    assert not laps_proven(later)
