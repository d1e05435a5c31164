"""Plan texts."""

from functools import lru_cache
from pathlib import Path

from place import ORIGIN

from common import ROOT
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.plan import Plan


def plan_of(text: str) -> Plan:
    """The plan of a text."""
    return read_plan(Text("p", text))[0]


@lru_cache
def survey() -> Plan:
    """The shipped survey."""
    return read_plan(read_text(str(ROOT / "plans/survey.plan")))[0]


def placed(text: str) -> str:
    """A plan with a place on the earth: its own, or that."""
    return text if "%: origin" in text else f"%: origin {ORIGIN[0]} {ORIGIN[1]}\n{text}"


def placed_survey(folder: Path) -> Path:
    """The shipped survey with a place on the earth, in a folder."""
    path = folder / "survey.plan"
    path.write_text(placed((ROOT / "plans/survey.plan").read_text()))
    return path


PARTS = """\
%: trigger-radius 1
path:
0.1; 90; x - 10
10, 100
[-900, 0]
[2, 10]
init:
n = 4
s = 0, next - s
next = min(s + 24 + 2*(45 - sqrt(2025 + c1)), 90)
top = 500 + 0.2*s
r2 = (2*57 - (next - s))/2
path:
0.1; 90; x - (10 + s)
10 + s, top
[-900, 0]
[2, 10]
0.002; 270; (x - (10 + s + 57))^2 + (y - top)^2 - 57^2
10 + s + 114, top
[-900, 0]
[0, 0]
0.1; 270; x - (10 + s + 114)
10 + s + 114, 0
[-900, 0]
[2, 10]
0.002; 270; (x - (10 + s + 114 - r2))^2 + y^2 - r2^2
10 + next, 0
[-900, 0]
[0, 0]
trig:
s >= 90
path:
0.1; 90; x - 100
100, 518
[-900, 0]
[2, 10]
"""

_LAPS = PARTS[PARTS.index("init:") : PARTS.index("trig:")]
_FAR = _LAPS.replace("10 + ", "100 + ").replace("500 + ", "900 + ").replace("114, 0", "114, 600")
TWO_BLOCKS = (
    PARTS
    + _FAR.replace("next, 0", "next, 600").replace("y^2 - r2", "(y - 600)^2 - r2")
    + """\
trig:
s >= 90
path:
0.1; 90; x - 190
190, 918
[-900, 0]
[2, 10]
"""
)
"""A way in, laps whose variables change from lap to lap, a way out."""

WAVES = """\
init:
a = 0, 90
h = 0, 50
path:
0.1; 270; 2*(y - h - 30*sin((x - a)/40))
a + 200, h + 30*sin(5)
0.1; 270; x - a - 90
a + 90, h + 50
trig:
2000, 2000
"""
"""Laps of a wave and a line, moved along and up."""

ROUND_AND_ON = "0.001; 90; x^2 + y^2 - 2500\n50, 0\n0.05; 90; x - 50\n50, 200\n"
"""A whole circle, and on along a line."""

STADIUM = """\
0.1; 270; x + 75
-75, 0, {}
0.002; 90; x^2 + y^2 - 75^2
75, 0, {}
0.1; 90; x - 75
75, 200, {}
0.002; 90; x^2 + (y - 200)^2 - 75^2
-75, 200, {}
"""
"""Two lines and two half circles, to be formatted with the radii of their triggers [m]."""

APPENDIX = """\
0.0003; 90; (x+45)^2+(y-146)^2-4900{sign}c1
-sqrt(4900+c1)-45, 146
[-3*10^3, 0]
[2, 10]
0.05; 270; x+sqrt(4900+c1)+45
-sqrt(4900+c1)-45, 11
[-3*10^3, 0]
[2, 10]
0.0003; 90; (x+sqrt(4900+c1)-30)^2+(y-11)^2-5625
-sqrt(4900+c1)+105, 11
[-3*10^3, 0]
[2, 10]
0.05; 90; x+sqrt(4900+c1)-105
-sqrt(4900+c1)+105, 147
[-3*10^3, 0]
[2, 10]
0.0003; 90; {fifth}
-3*sqrt(4900+c1)+105, 147
[-3*10^3, 0]
[0, 0]
"""
APPENDIX_RIGHT = APPENDIX.format(sign="-", fifth="(x+2*sqrt(4900+c1)-105)^2+(y-147)^2-4900-c1")
APPENDIX_PRINTED = APPENDIX.format(sign="+", fifth="(x-sqrt(4900+c1)+105)^2+(y-147)^2-4900+c1")
"""Draft 002's Appendix II, as corrected and with its misprints."""

SHORT = """\
%: computations fps
init:
n = 4
left = -115, 150 - 2*sqrt(4900 + c1)
right = 35, 150 - 2*sqrt(4900 + c1)
path:
0.006; 90; (x - left - sqrt(4900 + c1))^2 + (y - 146)^2 - 4900 - c1
left, 146
[-1000, 0]
[2, 10]
0.1; 270; x - left
left, 0
[-1000, 0]
[2, 10]
0.006; 90; (x - left - 75)^2 + y^2 - 75^2
right, 0
[-1000, 0]
[2, 10]
0.1; 90; x - right
right, 146
[-1000, 0]
[2, 10]
trig:
180, 146
"""
"""Laps on a circle, in the short form."""
