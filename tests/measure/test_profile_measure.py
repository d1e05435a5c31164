"""`eadp profile --measure` as it is called, in made-up time; what it writes is read by `eadp profile`."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from common.answers import refused

from eadp.errors import CommandError

ZONE = "class/powercap/intel-rapl:0"


class Computer:
    """A counter of energy under a made-up sysfs, and a command that draws 2 W and half a watt for each frame."""

    def __init__(self, root: Path) -> None:
        self.root, self.time_s, self.energy_uj, self.power_w = root, 0.0, 9_900_000.0, 1.0
        self.slept = 0
        self.ran: list[list[str]] = []
        self.ends = False
        (root / ZONE).mkdir(parents=True)
        (root / ZONE / "name").write_text("package-0\n", encoding="ascii")
        (root / ZONE / "max_energy_range_uj").write_text("10000000\n", encoding="ascii")
        self.sleep(0.0)

    def monotonic(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s
        self.slept += 1
        ripple_w = 0.001 * (-1) ** self.slept
        self.energy_uj = (self.energy_uj + 1e6 * (self.power_w + ripple_w) * duration_s) % 10_000_000
        (self.root / ZONE / "energy_uj").write_text(f"{round(self.energy_uj)}\n", encoding="ascii")

    @contextmanager
    def launched(self, arguments: Sequence[str], _clock: object) -> Iterator["Computer"]:
        if arguments[0] == "missing":
            raise CommandError("missing cannot be started: No such file or directory")
        self.ran.append(list(arguments))
        self.power_w = 2 + float(arguments[-1]) / 2
        yield self
        self.power_w = 1.0

    def exit_code(self) -> int | None:
        return 1 if self.ends else None

    def output_tail(self) -> str:
        return ""


@pytest.fixture
def computer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Computer:
    made = Computer(tmp_path / "sys")
    monkeypatch.setattr("eadp.measure.measuring.time", made)
    monkeypatch.setattr("eadp.measure.measuring.launched", made.launched)
    return made


@pytest.fixture
def measured(computer: Computer, eadp: Callable[..., object]) -> Callable[..., object]:
    return lambda *options: eadp("profile", "--measure", "--sysfs", computer.root, *options)


def test_measured_written_and_read(computer: Computer, measured, eadp, tmp_path: Path) -> None:
    file = tmp_path / "measured.csv"
    answer = measured("--config", "fps=2,4,6", "-o", file, "--", "./detect", "--rate", "{fps}")
    assert (answer.code, answer.out) == (0, "")
    found, *each = answer.err.splitlines()
    assert found == f"--sensor:1:1: note: powercap:package-0 at {computer.root / ZONE}"
    means = [f"fps={f}: {2 + f / 2:.4f} W ± 0.0002 W (30 samples, 30 independent)" for f in (2, 4, 6)]
    assert each == [f"--measure:1:1: note: {mean}" for mean in means]
    assert computer.ran == [["./detect", "--rate", str(fps)] for fps in (2, 4, 6)]
    again = eadp("profile", file, "--at", "fps=3", "--format", "text")
    assert (again.code, again.out, again.err) == (0, "fps=3: 3.5 W\n", "")


def test_without_a_file_it_is_on_stdout(measured) -> None:
    answer = measured("--config", "fps=2,6", "--", "./detect", "{fps}")
    assert answer.code == 0
    lines = answer.out.splitlines()
    assert lines[2:4] == ["fps,power_w", "2,2.999"]
    assert len(lines) == 3 + 2 * 30


def test_not_accurate_enough_is_said(measured) -> None:
    answer = measured("--config", "fps=2,4", "--longest", "2", "--", "./detect", "{fps}")
    assert answer.code == 0
    said = [line for line in answer.err.splitlines() if "warning" in line]
    assert said == [f"--longest:1:1: warning: fps={fps}: not as accurate as asked within 2 s" for fps in (2, 4)]


def test_a_command_that_fails_leaves_nothing(computer: Computer, measured, tmp_path: Path) -> None:
    file = tmp_path / "measured.csv"
    before = sorted(tmp_path.iterdir())
    answer = measured("--config", "fps=2,4", "-o", file, "--", "missing", "{fps}")
    assert (answer.code, answer.out) == (2, "")
    assert "--measure:1:1: error: fps=2: missing cannot be started: No such file or directory; expected" in answer.err
    computer.ends = True
    answer = measured("--config", "fps=2,4", "-o", file, "--", "./detect", "{fps}")
    assert refused(answer, "error: fps=2: the command ended by itself with exit code 1; expected")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("options", "start"),
    [
        (["--", "a", "{fps}"], "--config:1:1: error: nothing to measure"),
        (["--config", "fps=2,4", "--", "a"], "--measure:1:1: error: the command does not use fps"),
        (["--config", "fps=2", "--accuracy", "0", "--", "{fps}"], "--accuracy:1:1: error: 0 is out of range; expected"),
        (["--config", "fps=2", "--interval", "0", "--", "{fps}"], "--interval:1:1: error: 0 is out of range"),
        (["--config", "fps=2", "--sensor", "hwmon:x", "--", "{fps}"], "--sensor:1:1: error: no such sensor; expected"),
        (["--config", "fps=2", "--format", "json", "--", "{fps}"], "--format:1:1: error: has no effect here"),
    ],
)
def test_usage_that_is_refused(computer: Computer, measured, options: list[str], start: str) -> None:
    answer = measured(*options)
    assert (answer.code, answer.out, computer.ran) == (2, "", [])
    assert answer.err.startswith(start)
