"""Fuzz a reader by coverage: by hand, not in the test suite. What it finds is fixed, and gets a test.

usage: pip install atheris; python benchmarks/fuzz.py TARGET [--seconds 600] [--corpus DIR] [--seeds DIR]

Whatever the bytes: nothing but the project's own errors, in printable lines; no more than `SLOW_S` and `MEMORY_MB`; no
process started, no file written elsewhere, no text of the input compiled. What can be read is used: plans are printed,
read again and checked, scenarios flown for some steps, fields covered, telemetry re-planned on. Findings are counted
by the line that failed, and the smallest input of each is kept in DIR/findings; an input that hangs, or takes too much
memory, ends the run. Seeds are files of the repository, made ones, and those of other folders.
Known: a strip 36 km long takes 2 s to cover, which is reported.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line sets it

import argparse
import importlib
import io
import itertools
import json
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import Any

import atheris
from pymavlink.dialects.v20 import ardupilotmega as dialect

with atheris.instrument_imports(include=["eadp", "pyulog", "pymavlink.DFReader"]):
    import numpy as np

    from eadp.api.inputs import Files, load_flight
    from eadp.check.check import check_plan
    from eadp.core.compiled import enable
    from eadp.errors import EadpError, InputError
    from eadp.exchange.item_map import parse_items
    from eadp.io import scenario as scenario_file
    from eadp.io.energy import energy_yaml, parse_energy
    from eadp.io.logs import autopilot_process
    from eadp.io.logs import tables as messages
    from eadp.io.plan.reader import read_plan
    from eadp.io.plan.sources import PlanReader, is_mission
    from eadp.io.plan.writer import plan_text
    from eadp.io.profile import model_file
    from eadp.io.profile.configurations import as_trace
    from eadp.io.profile.measurements import Configuration, Trace, read_measurements
    from eadp.io.profile.model_file import parse_profile, profile_yaml
    from eadp.io.text.streams import Text
    from eadp.live.decisions import json_line
    from eadp.live.link import LinkFlight, LinkOptions
    from eadp.live.mavlink import Codec, tlog_messages
    from eadp.live.messages import WANTED
    from eadp.live.recorded import MAGICS, log_values
    from eadp.live.replanner import replan_lines
    from eadp.live.telemetry import TelemetryLine
    from eadp.live.telemetry_log import ReplanLog
    from eadp.measure.csv_log import read_csv_log
    from eadp.measure.energy_fit import fit_energy
    from eadp.measure.formats import read_power_log
    from eadp.measure.power_log import Columns
    from eadp.models.plan.plan import Site
    from eadp.models.plan.trace import nominal_legs
    from eadp.simulation.loop import Outcome, fly
    from eadp.survey.coverage import CoverageRequest, cover
    from eadp.survey.field_reader import read_airspace, read_field
    from eadp.survey.plan_builder import build_plan
    from eadp.survey.swaths import MotionLimits
    from eadp.sweep import sweep_file
    from eadp.sweep.results import Results
    from eadp.sweep.runs import Result, Run
    from eadp.sweep.sweep_file import load_run, read_sweep

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests/support"))
SLOW_S, HANG_S, MEMORY_MB = 2.0, 60, 2048
"""CPU time of an input that is a finding; time at which the run ends; memory of the whole process."""
LIBRARY_S, LIBRARY_BYTES = 1.0, 400_000_000
"""Time and memory of a library that reads autopilots' logs: its process has limits, too."""
SCRATCH = Path(tempfile.mkdtemp(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)) / "input"
PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")


@dataclass(frozen=True)
class Target:
    """What reads the bytes; the seeds in the repository, and names of further ones; the size of an input [bytes]."""

    read: Callable[[bytes], None]
    seeds: tuple[str, ...] = ()
    max_bytes: int = 8192
    made: Callable[[], list[bytes]] = list


def text_of(data: bytes) -> Text:
    return Text("fuzz", data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n"))


def plan(data: bytes) -> None:
    """Read, print, read again, check."""
    read, _ = read_plan(text_of(data))
    printed = plan_text(read)
    try:
        again, _ = read_plan(Text("again", printed))
    except InputError as error:
        # blanks that the canonical text adds may take an expression over its limit of characters
        if not ("characters" in str(error) or "nested" in str(error)):
            raise RuntimeError(printed) from error
        return
    assert plan_text(again) == printed, "not canonical"
    check_plan(read)
    nominal_legs(read, [box.hi for box in read.stages[0].sets] or [0.0] * read.path_count)


def mission(data: bytes) -> None:
    """Read a mission of other software, and check it as a plan."""
    text = text_of(data)
    if not is_mission(text):
        return
    read, _ = PlanReader()(text)
    check_plan(read)


KNOWN = Files()
"""Files that need no reading for each input."""


def flown(text: Text, texts: dict[str, Text]) -> None:
    """Load a flight with a scenario, and fly some steps by its planner."""
    files = Files({**KNOWN.texts, text.name: text, **texts})
    files._contents.update(KNOWN._contents)
    inputs = load_flight(PLAN, scenario=text.name, files=files)
    world = inputs.world
    clock = world.clock
    limited = replace(world, clock=clock._replace(time_limit_s=min(clock.time_limit_s, 20 * clock.step_s)))
    for _ in itertools.islice(fly(limited, inputs.flight(), Outcome()), 20):
        pass


def scenario(data: bytes) -> None:
    flown(replace(text_of(data), name=str(ROOT / "scenarios/fuzz.yaml")), {})


def vehicle(data: bytes) -> None:
    body = Path(SCENARIO).read_text() + "vehicle: ../vehicles/fuzz.yaml\n"
    named = str(ROOT / "scenarios/../vehicles/fuzz.yaml")
    flown(Text(str(ROOT / "scenarios/fuzz.yaml"), body), {named: replace(text_of(data), name=named)})


def sweep(data: bytes) -> None:
    read = read_sweep(replace(text_of(data), name=str(ROOT / "scenarios/fuzz.yaml")))
    for index in (0, len(read.design) // 2, len(read.design) - 1):
        load_run(read.kept, read.run(index))


def profile(data: bytes) -> None:
    read, _ = parse_profile(text_of(data))
    printed = profile_yaml(read)
    assert profile_yaml(parse_profile(Text("again.yaml", printed))[0]) == printed, "not canonical"


def energy(data: bytes) -> None:
    printed = energy_yaml(parse_energy(text_of(data)))
    assert energy_yaml(parse_energy(Text("again", printed))) == printed, "not canonical"


def power_log(data: bytes) -> None:
    log = read_csv_log(text_of(data), Columns())
    if zlib.crc32(data) % 16 == 0:
        fit_energy(log.times_s, log.power_w)


def field(data: bytes) -> None:
    read, _ = read_field(text_of(data), metres=zlib.crc32(data) % 2 == 0)
    if zlib.crc32(data) % 16 < 2 and len(read.outline) < 50:
        solution = cover(CoverageRequest(read, MotionLimits(60.0, 30.0, 45.0, 30.0)))
        plan_text(build_plan(solution, site=Site(read.origin_deg)))


MEADOW = Text("meadow.csv", "lon,lat\n10,55\n10.01,55\n10.01,55.01\n10,55.01\n")


def zones(data: bytes) -> None:
    """Read zones, as fences are, beside a field."""
    meadow, _ = read_field(MEADOW)
    avoid, inside = (text_of(data), None) if zlib.crc32(data) % 2 else (None, text_of(data))
    read_airspace(avoid, inside, meadow.origin_deg, meadow.middle_m)


ONE = Configuration(("fps",), ("",), (1.0,))


def recording(data: bytes) -> None:
    """Read what a power sensor's program recorded, as the trace of a configuration."""
    read_measurements([Trace(as_trace(text_of(data)), ONE)], ())


def scratch(data: bytes) -> str:
    """A file of the bytes."""
    SCRATCH.write_bytes(data)
    return str(SCRATCH)


def autopilot_log(data: bytes) -> None:
    read_power_log(scratch(data), Columns())


def in_process(command: list[str], **_: Any) -> subprocess.CompletedProcess[bytes]:
    """Stands for the process that reads autopilots' logs: its functions, here, under a limit of time and memory."""
    import resource

    form, path, topics = command[-3:]
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (used + LIBRARY_BYTES, hard))
    signal.signal(signal.SIGPROF, _end)
    signal.setitimer(signal.ITIMER_PROF, LIBRARY_S, 0.1)
    output = io.BytesIO()
    try:
        read = autopilot_process._ulog if form == "ulog" else None
        columns = read(path, topics.split(",")) if read else autopilot_process._dataflash(form, path, topics.split(","))
        np.savez(output, **columns)
    except (Exception, _LimitReached) as error:
        return subprocess.CompletedProcess(command, 1, b"", str(error).encode(errors="replace"))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    return subprocess.CompletedProcess(command, 0, output.getvalue(), b"")


class _LimitReached(BaseException):
    """Of time; the libraries catch every Exception."""


def _end(*_: Any) -> None:
    raise _LimitReached


class Telemetry:
    """Re-planning on telemetry, or from a log where the bytes start with the kind of its first line."""

    def __init__(self) -> None:
        self.inputs: list[Any] = []

    def __call__(self, data: bytes) -> None:
        """Re-plan: static mostly, the other planners seldom, as they take longer."""
        if not self.inputs:
            names = ["static"] * 6 + ["paper", "joint"]
            loaded = {name: load_flight(PLAN, scenario=SCENARIO, overrides={"planner.name": name}) for name in names}
            self.inputs = [loaded[name] for name in names]
        inputs = self.inputs[zlib.crc32(data) % len(self.inputs)]
        stream, log = data, None
        if data.startswith(b'{"kind"'):
            stream = b""
            SCRATCH.unlink(missing_ok=True)
            ReplanLog(str(SCRATCH), "fuzz").close()
            with SCRATCH.open("ab") as file:
                file.write(data[data.find(b"\n") + 1 :])
            log = ReplanLog(str(SCRATCH), "fuzz")
        try:
            replan_lines(inputs, io.BytesIO(stream), "fuzz", log, json_line, str)
        finally:
            if log is not None:
                log.close()


class Link:
    """A flight over a link that may upload and return: the bytes as the fields of messages, and as frames."""

    def __init__(self) -> None:
        self._inputs: Any = None
        self._items, self._heartbeat = "", b""

    def flight(self) -> LinkFlight:
        """A new flight of the survey, which answers to the mission protocol."""
        if self._inputs is None:
            placed = importlib.import_module("common.plans").placed_survey(SCRATCH.parent)
            self._inputs = load_flight(str(placed), scenario=SCENARIO, overrides={"planner.name": "static"})
            mission = SCRATCH.with_name("placed.waypoints")
            command = [sys.executable, "-m", "eadp", "export", str(placed), "--to", "ardupilot", "-o", str(mission)]
            subprocess.run(command, check=True, capture_output=True)
            self._items = f"{mission}.items.json"
            autopilot = importlib.import_module("mavlink_vehicle").Autopilot()
            self._heartbeat = autopilot.heartbeat(armed=True, active=True)
        out = Codec(frozenset())
        return LinkFlight(
            self._inputs,
            "link",
            LinkOptions(self._items, upload=True, return_home=True),
            None,
            json_line,
            str,
            out.encoded,
        )

    def __call__(self, data: bytes) -> None:
        """Take messages of 48 bytes each: the kind, the component, the time that goes by, and the payload."""
        flight, codec, now_s = self.flight(), Codec(WANTED), 0.0
        frames = [framed(data[i : i + 48]) for i in range(0, min(len(data), 4800), 48)]
        for frame, step in zip([self._heartbeat, *frames, data], [0, *data[2::48], 1], strict=False):
            now_s += step / 100
            for message in codec.decoded(frame):
                flight.take(message, now_s)
            flight.tick(now_s)


LINK = Link()


def framed(data: bytes) -> bytes:
    """A frame of a message with a payload: its checksum is right."""
    kinds = sorted(number for number, each in dialect.mavlink_map.items() if each.msgname in WANTED)
    kind = dialect.mavlink_map[kinds[data[0] % len(kinds)]]
    component = 1 if len(data) < 2 or data[1] < 224 else data[1]
    payload = (data[3:] or b"\0")[: kind.unpacker.size]
    head = bytes([len(payload), 0, 0, 0, 1, component, *kind.id.to_bytes(3, "little")])
    return b"\xfd" + head + payload + struct.pack("<H", dialect.x25crc(head + payload + bytes([kind.crc_extra])).crc)


def tlog(data: bytes) -> None:
    """Replay a telemetry log, and an autopilot's own where the bytes start as one."""
    flight = LINK.flight()
    form = next((form for magic, form in MAGICS.items() if data.startswith(magic)), None)
    if form is not None:
        for values in log_values(scratch(data), form):
            flight.update(values)
    for message in tlog_messages(data, WANTED):
        flight.take(message)


def items(data: bytes) -> None:
    parse_items(text_of(data), ("c1",))


def results(data: bytes) -> None:
    """Read what is there, then go on with the sweep."""
    run = Run("fuzz", {"plan": "p"}, {"seed": 1})
    with closing(Results(scratch(data), read_only=True)) as read:
        read.expect(f"k{i}" for i in range(5))
        for summaries in (False, True):
            list(read.rows(summaries=summaries))
    with closing(Results(str(SCRATCH))) as own:
        own.expect([run.key])
        if own.missing():
            own.store([(each, Result(None, "no", 1.0)) for each in own.claim([run])[0]])
            assert not own.missing(), "a stored result is missing"
        assert len(list(own.rows())) == 1


# --- seeds that are no files of the repository

KML = b"""<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark id="a"><name>f</name>
<Polygon><outerBoundaryIs><LinearRing><coordinates>10,55,0 10.01,55 10.01,55.01 10,55.01 10,55</coordinates>
</LinearRing></outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>10.004,55.004 10.006,55.004 10.006,55.006
</coordinates></LinearRing></innerBoundaryIs></Polygon></Placemark></Document></kml>"""
ENERGY = b"schema: eadp.energy/1\nperiod_s: 46\nmean_w: 36.4\nharmonics:\n- {amplitude_w: 2, phase_rad: 1}\n"


def energies() -> list[bytes]:
    log = read_csv_log(text_of((ROOT / "scenarios/example-power-log.csv").read_bytes()), Columns())
    return [ENERGY, energy_yaml(fit_energy(log.times_s, log.power_w).model).encode()]


def made_vertices() -> list[bytes]:
    return [b"x_m,y_m\n0,0\n300,0\n300,200\n0,200\n", b"ring;lon;lat\n0;10;55\n0;10.01;55\n0;10;55.01\n1;1;1\n"]


def fences() -> list[bytes]:
    commands = [(5001, 4), (5001, 4), (5001, 4), (5001, 4), (5004, 20), (5000, 0), (5100, 0)]
    rows = (
        f"{i}\t0\t3\t{c}\t{p}\t0\t0\t0\t{55 + i / 900}\t{10 + i * i / 900}\t0\t1" for i, (c, p) in enumerate(commands)
    )
    corner = {"inclusion": False, "circle": {"center": [55.005, 10.005], "radius": 20}}
    square = {"inclusion": True, "polygon": [[55, 10], [55.01, 10], [55.01, 10.01]]}
    plan = {"fileType": "Plan", "geoFence": {"version": 2, "polygons": [square], "circles": [corner]}}
    return ["\n".join(["QGC WPL 110", *rows, ""]).encode(), json.dumps(plan).encode(), KML]


def recordings() -> list[bytes]:
    board = "10-01-2025 20:05:55 RAM 2274/6834MB CPU [99%@1189,off] VDD_IN 5000mW/5000mW POM_5V_IN 2345/2300\n"
    graphics = "timestamp, power.draw [W], clocks\n2024/01/01 10:00:00, 23.45 W, 5\nx, [N/A], 5\n"
    ina = "Bus Voltage (V);Current (mA);Power (mW)\n5;1000;4990\n"
    return [text.encode() for text in (board, graphics, ina, "time_s,bus_voltage_v,current_ma\n0,5,1000\n")]


def autopilot_logs() -> Any:
    """The module of the tests that makes such logs."""
    sys.path.append(str(ROOT / "tests/io/log"))
    return importlib.import_module("test_autopilot")


def dataflash_logs() -> list[bytes]:
    tests = autopilot_logs()
    return [tests.dataflash(), tests.dataflash(2), tests.text_log().encode()]


def replan_logs() -> list[bytes]:
    lines = (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()[:8]
    return ["\n".join(['{"kind": "start"}', *(f'{{"kind": "telemetry", {line[1:]}' for line in lines), ""]).encode()]


def link_frames() -> list[bytes]:
    vehicle = importlib.import_module("mavlink_vehicle")
    found = vehicle.frames(vehicle.recorded(str(ROOT / "scenarios/example-telemetry.jsonl"))[:20], vehicle.Autopilot())
    return [b"".join(frame for _, parts in found for frame in parts), bytes(range(256)) * 8]


def telemetry_logs() -> list[bytes]:
    sys.path.append(str(ROOT / "tests/io/link"))
    tests, vehicle = importlib.import_module("test_recorded"), importlib.import_module("mavlink_vehicle")
    lines = vehicle.recorded(str(ROOT / "scenarios/example-telemetry.jsonl"))[:20]
    own = [tests.ulog(tests.px4(lines)), tests.dataflash(tests.ardupilot(lines))]
    return [vehicle.tlog(vehicle.frames(lines, vehicle.Autopilot())), *own]


def item_maps() -> list[bytes]:
    LINK.flight()
    return [Path(LINK._items).read_bytes()]


def results_files() -> list[bytes]:
    with closing(Results(scratch(b""))) as made:
        made.store([(Run(f"k{i}", {"plan": "p"}, {"seed": i}), Result(None, "no", 1.0)) for i in range(5)])
    return [SCRATCH.read_bytes()]


TARGETS = {
    "plan": Target(plan, ("plans/*.plan", "tests/bad/*.plan", "*.pln")),
    "mission": Target(mission, ("missions/*",)),
    "scenario": Target(scenario, ("scenarios/paper*.yaml", "scenarios/survey.yaml")),
    "vehicle": Target(vehicle, ("vehicles/*.yaml",)),
    "sweep": Target(sweep, ("scenarios/sweep*.yaml",)),
    "profile": Target(profile, ("profiles/*",)),
    "energy": Target(energy, made=energies),
    "log": Target(power_log, ("scenarios/*.csv", "logs/*.csv", "flights/*.csv")),
    "kml": Target(field, ("*.kml",), made=lambda: [KML]),
    "geojson": Target(field, ("plans/*.geojson", "fields/*.geojson")),
    "zones": Target(zones, ("*fence*.txt", "*rally*.txt"), made=fences),
    "recording": Target(recording, ("*tegrastats*.log",), made=recordings),
    "vertices": Target(field, made=made_vertices),
    "ulog": Target(autopilot_log, ("*.ulg",), made=lambda: [autopilot_logs().ulog(), autopilot_logs().ulog(2)]),
    "dataflash": Target(autopilot_log, ("*.bin",), made=dataflash_logs),
    "tlog-power": Target(autopilot_log, ("*.tlog",), made=lambda: telemetry_logs()[:1], max_bytes=40_000),
    "telemetry": Target(Telemetry(), ("scenarios/*.jsonl",), made=replan_logs),
    "link": Target(LINK, made=link_frames),
    "tlog": Target(tlog, made=telemetry_logs, max_bytes=40_000),
    "items": Target(items, made=item_maps),
    "results": Target(results, made=results_files, max_bytes=100_000),
}


# --- the run


@dataclass
class Fuzzer:
    """Gives a target inputs, and keeps the smallest one of each finding."""

    target: Target
    folder: Path
    found: dict[str, int] = dataclass_field(default_factory=dict)
    reading: str = ""

    def one(self, data: bytes) -> None:
        """Read an input, and keep what is a finding: one that is slow is read twice, as the first imports."""
        took_s = self.read(data)
        if took_s > SLOW_S and (took_s := self.read(data)) > SLOW_S:
            self.keep("slow", data, f"{took_s:.1f} s")

    def read(self, data: bytes) -> float:
        """Read an input; returns the CPU time [s]."""
        self.reading = data.decode("utf-8", errors="replace")
        problem = None
        start_s = time.process_time()
        try:
            self.target.read(data)
        except EadpError as error:
            if not all(line.isprintable() for line in str(error).splitlines()):
                problem = "not printable", data, str(error)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            site = f"{type(error).__name__} {Path(frame.filename).name} {frame.lineno}"
            problem = site, data, traceback.format_exc()
        took_s = time.process_time() - start_s
        self.reading = ""
        if problem:
            self.keep(*problem)
        return took_s

    def keep(self, site: str, data: bytes, text: str) -> None:
        """Keep an input if it is the smallest of its finding."""
        if len(data) < self.found.get(site, sys.maxsize):
            new = "" if site in self.found else f"finding: {site}\n{text}\n"
            sys.stderr.write(new)
            self.found[site] = len(data)
            (self.folder / site.replace(" ", "-")).write_bytes(data)

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse what no input may cause: processes, connections, files written elsewhere, its own text compiled."""
        if not self.reading:
            return
        if event in FORBIDDEN:
            raise RuntimeError(f"an input causes {event}: {arguments}")
        writes = event == "open" and isinstance(arguments[1], str) and arguments[1].strip("brt")
        if writes and not str(arguments[0]).startswith(str(SCRATCH.parent)):
            raise RuntimeError(f"an input writes {arguments[0]}")
        if event == "compile" and isinstance(arguments[0], str) and arguments[0].strip() in self.reading:
            raise RuntimeError(f"an input's text is compiled: {arguments[0]}")


NUMBERS = ("-1", "0", "1e300", "-1e300", "1e-300", "nan", "null", "true", "[]", "{}")
FORBIDDEN = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "os.rename")


def seed_files(target: Target, elsewhere: list[str]) -> list[bytes]:
    """The seeds of a target: those that are made, and files of the repository and of other folders."""
    files = {path for root in (ROOT, *map(Path, elsewhere)) for name in target.seeds for path in root.rglob(name)}
    return [*target.made(), *(path.read_bytes() for path in sorted(files))]


def main() -> None:
    """Fuzz one target."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--corpus", type=Path, help="folder of the corpus and of findings; default: a temporary one")
    parser.add_argument("--seeds", action="append", default=[], help="another folder with seeds; may repeat")
    options = parser.parse_args()
    target = TARGETS[options.target]
    corpus = options.corpus or Path(tempfile.mkdtemp(prefix=f"fuzz-{options.target}-"))
    findings = corpus / "findings"
    findings.mkdir(parents=True, exist_ok=True)
    (seeds := corpus / "seeds").mkdir(exist_ok=True)
    schemas = json.dumps([scenario_file.json_schema(), sweep_file.json_schema(), model_file.json_schema()])
    words = {*re.findall(r'"([a-z]\w+)": \{', schemas), *NUMBERS, *TelemetryLine.model_fields}
    (corpus / "words.dict").write_text("".join(f'"{word}"\n' for word in sorted(words)))
    for i, data in enumerate(seed_files(target, options.seeds)):
        for j, part in enumerate({data[: target.max_bytes], data[:500]}):
            (seeds / f"seed{i}-{j}").write_bytes(part)
    enable(False)
    load_flight(PLAN, scenario=SCENARIO, files=KNOWN)
    LINK.flight()
    messages.subprocess.run = in_process  # type: ignore[attr-defined]
    sys.dont_write_bytecode = True
    tempfile.tempdir = str(SCRATCH.parent)
    fuzzer = Fuzzer(target, findings)
    sys.addaudithook(fuzzer.audit)
    limits = [f"-max_total_time={options.seconds}", f"-timeout={HANG_S}", f"-rss_limit_mb={MEMORY_MB}"]
    rest = [
        f"-max_len={target.max_bytes}",
        f"-artifact_prefix={findings}/",
        f"-dict={corpus}/words.dict",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *limits, *rest, str(corpus), str(seeds)], fuzzer.one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
