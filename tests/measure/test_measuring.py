"""The measuring loop and `eadp profile --measure`, in made-up time, and one real command with a child of its own."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from common.answers import refused

from eadp.core.signals import average
from eadp.errors import CommandError, InputError
from eadp.io.profile.model_file import parse_profile
from eadp.io.text.streams import Text
from eadp.measure.measuring import (
    MIN_SAMPLES,
    Configuration,
    Launch,
    MeasureOptions,
    Sensor,
    check_command,
    fill_placeholders,
    launched,
    mean_text,
    measure,
    measurements_csv,
)

IDLE_W, WARM_UP_W = 1.5, 50.0


def at(*fps: float) -> list[Configuration]:
    return [Configuration(("fps",), ("1/s",), (float(value),)) for value in fps]


@dataclass
class Board:
    """A computer in made-up time: a clock, a sensor in a file, and commands that draw power while they run.

    `power_w` is asked for the power at a frame rate, so long after the command began [s].
    """

    file: Path
    power_w: Callable[[float, float], float]
    ends_at_s: float = float("inf")
    interrupted_at_s: float = float("inf")
    time_s: float = 100.0
    began: tuple[float, float] | None = None
    events: list[str] = field(default_factory=list)

    def monotonic(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        assert duration_s >= 0
        self.time_s += duration_s
        if self.time_s >= self.interrupted_at_s:
            raise KeyboardInterrupt
        self.show()

    def show(self) -> None:
        power_w = self.power_w(self.began[0], self.time_s - self.began[1]) if self.began else IDLE_W
        self.file.write_text(str(round(1e6 * power_w)), encoding="ascii")

    @contextmanager
    def launch(self, arguments: Sequence[str], clock: object) -> Iterator["Board"]:
        assert clock is self
        assert self.began is None, "one at a time"
        self.events.append(f"start {' '.join(arguments)}")
        self.began = (float(arguments[-1]), self.time_s)
        self.show()
        try:
            yield self
        finally:
            self.events.append("end")
            self.began = None
            self.show()

    def exit_code(self) -> int | None:
        return 3 if self.began and self.time_s - self.began[1] >= self.ends_at_s else None

    def output_tail(self) -> str:
        return "loading\nno camera\x1b\n"

    @property
    def sensor(self) -> Sensor:
        return Sensor("hwmon", "board/power1", self.file, (self.file,), 1e-6)


@pytest.fixture
def board(tmp_path: Path) -> Callable[..., Board]:
    def make(power_w: Callable[[float, float], float], **others: float) -> Board:
        made = Board(tmp_path / "power1_input", power_w, **others)  # type: ignore[arg-type]
        made.show()
        return made

    return make


def warm(fps: float, since_s: float) -> float:
    """After a warm-up, steady but for a ripple that two samples in a row take away."""
    return WARM_UP_W if since_s < 5 - 1e-9 else 2 + fps / 2 + 0.001 * (-1) ** round(since_s / 0.2)


def noisy(deviation_w: float) -> Callable[[float, float], float]:
    rng = np.random.default_rng(5)
    return lambda fps, _since_s: max(0.0, 5 + fps / 2 + deviation_w * float(rng.standard_normal()))


def run(board: Board, configurations: Sequence[Configuration], **settings: float) -> list:
    given = ["detect", "{fps}"], configurations, board.sensor, MeasureOptions(**settings)
    return measure(*given, board, board.launch)


def test_each_configuration_is_run_and_its_warm_up_dropped(board: Callable[..., Board]) -> None:
    made = board(warm)
    measured = run(made, at(2, 4.5))
    assert made.events == ["start detect 2", "end", "start detect 4.5", "end"]
    assert [each.average.mean for each in measured] == pytest.approx([3, 4.25])
    # steady power is known after the fewest samples
    assert [len(each.powers_w) for each in measured] == [MIN_SAMPLES, MIN_SAMPLES]
    assert all(each.accurate for each in measured)
    assert made.time_s == pytest.approx(100 + 2 * (5 + MIN_SAMPLES * 0.2))


def test_it_measures_until_the_mean_is_known(board: Callable[..., Board]) -> None:
    (measured,) = run(board(noisy(1.0)), at(4), warmup_s=0, accuracy_w=0.1, longest_s=1000)
    assert measured.accurate
    assert measured.average.standard_error <= 0.1
    # σ²/n = 0.1² at n = 100 if they are independent, as they are
    assert 80 <= len(measured.powers_w) <= 200
    assert measured.average.mean == pytest.approx(7, abs=0.4)
    assert measured.average == average([measured.powers_w])


def test_it_ends_after_the_longest_time(board: Callable[..., Board]) -> None:
    made = board(noisy(1.0))
    (measured,) = run(made, at(4), warmup_s=0, accuracy_w=0.001, longest_s=10)
    assert not measured.accurate
    assert len(measured.powers_w) == 50
    assert made.time_s <= 110 + 1e-6


def test_a_command_that_ends_by_itself(board: Callable[..., Board]) -> None:
    for ends_at_s in (1.0, 7.0):  # in its warm-up, and while it is measured
        made = board(warm, ends_at_s=ends_at_s)
        with pytest.raises(InputError) as caught:
            run(made, at(2, 4))
        assert str(caught.value) == (
            "--measure:1:1: error: fps=2: the command ended by itself with exit code 3; its last output: "
            "no camera\\x1b; expected a command that runs until it is stopped"
        )
        assert made.events == ["start detect 2", "end"]


@pytest.mark.parametrize("at_s", [102.0, 106.0, 112.0])
def test_an_interrupt_ends_the_command(board: Callable[..., Board], at_s: float) -> None:
    made = board(warm, interrupted_at_s=at_s)
    with pytest.raises(KeyboardInterrupt):
        run(made, at(2, 4))
    assert made.events.count("end") == len(made.events) / 2
    assert made.began is None


def test_a_sensor_that_fails_ends_the_command(board: Callable[..., Board]) -> None:
    def broken(_fps: float, since_s: float) -> float:
        if since_s > 6:
            made.file = made.file.with_name("gone")
            (made.file.with_name("power1_input")).unlink(missing_ok=True)
        return 3.0

    made = board(broken)
    with pytest.raises(InputError, match="power1_input:1:1: error: cannot be read"):
        run(made, at(2))
    assert made.events == ["start detect 2", "end"]


def test_places_in_the_command() -> None:
    configuration = Configuration(("fps", "scale"), ("", ""), (2.0, 0.5))
    filled = fill_placeholders(["a", "--rate={fps}", "{scale}x{fps}", "{other}", "{}"], configuration)
    assert filled == ["a", "--rate=2", "0.5x2", "{other}", "{}"]
    check_command(["a", "x{fps}"], ["fps"])
    with pytest.raises(InputError, match=r"the command does not use scale; expected \{scale\} in one"):
        check_command(["a", "{fps}"], ["fps", "scale"])
    with pytest.raises(InputError, match="no command"):
        check_command([], ["fps"])


def test_what_was_measured_is_read_back(board: Callable[..., Board]) -> None:
    made, settings = board(noisy(0.5)), MeasureOptions(warmup_s=0, accuracy_w=0.2)
    measured = measure(["detect", "{fps}"], at(2, 4, 6), made.sensor, settings, made, made.launch)
    body = measurements_csv(measured, ["detect", "{fps}"], made.sensor, settings)
    assert body.splitlines()[:3] == [
        "# source: measured with hwmon:board/power1, a sample every 0.2 s after 0 s",
        "# command: detect {fps}",
        "fps [1/s],power_w",
    ]
    profile, warnings = parse_profile(Text("m.csv", body))
    assert (profile.names, profile.units) == (("fps",), ("1/s",))
    assert [fault for fault in warnings if "few" not in fault.message] == []
    assert profile.source == "measured with hwmon:board/power1, a sample every 0.2 s after 0 s"
    assert profile.power_w == pytest.approx([each.average.mean for each in measured], abs=1e-9)
    assert profile.standard_error_w == pytest.approx([each.average.standard_error for each in measured], abs=1e-9)
    assert mean_text(average([[3.0]])) == "3.0000 W ± 0.0000 W (1 samples, standard deviation unknown)"


_CHILD = """
import os, subprocess, sys
fifo, grandchild = sys.argv[1:]
out = os.open(fifo, os.O_WRONLY)
print("up", flush=True)
subprocess.Popen([sys.executable, "-c", grandchild, str(out)], pass_fds=[out])
import time
time.sleep(60)
os.write(out, b" the child lived on")
"""
_GRANDCHILD = """
import os, signal, sys, time
signal.signal(signal.SIGTERM, {how})
os.write(int(sys.argv[1]), b"ready")
time.sleep(60)
os.write(int(sys.argv[1]), b" the grandchild lived on")
"""


class Impatient:
    """Time that passes only by being slept through, and at no cost."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def monotonic(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        os.sched_yield()
        self.time_s += duration_s


@pytest.mark.parametrize("how", ["signal.SIG_DFL", "signal.SIG_IGN"], ids=["that ends", "that ignores SIGTERM"])
def test_a_command_is_ended_with_all_that_it_started(tmp_path: Path, how: str) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    command = [sys.executable, "-c", _CHILD, str(fifo), _GRANDCHILD.format(how=how)]
    with suppress(KeyboardInterrupt), launched(command, Impatient()) as running:
        stream = os.open(fifo, os.O_RDONLY)  # waits for the child
        heard = os.read(stream, 5)  # waits for the grandchild
        assert running.exit_code() is None
        assert running.output_tail() == "up\n"
        raise KeyboardInterrupt
    # until the last that could write to it is gone
    while piece := os.read(stream, 100):
        heard += piece
    os.close(stream)
    assert heard == b"ready"
    assert running.exit_code() is not None


def test_a_command_that_cannot_be_started() -> None:
    launch: Launch = launched
    for arguments, reason in ((["/no/such/program"], "No such file"), (["a\0b"], "null byte"), (["/"], "Permission")):
        with pytest.raises(CommandError, match=f"cannot be started: .*{reason}"), launch(arguments, Impatient()):
            pytest.fail("it did not start")


def test_a_command_that_ended_says_how() -> None:
    with launched([sys.executable, "-c", "import sys; sys.exit('out of paper')"], Impatient()) as running:
        running.popen.wait()  # type: ignore[attr-defined]
        assert running.exit_code() == 1
        assert running.output_tail() == "out of paper\n"


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
