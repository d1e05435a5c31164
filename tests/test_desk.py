"""The tutorial's flight in two terminals, by its own command lines: the aeroplane in JSBSim beside `eadp replan`."""

import json
import re
import shlex
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pymavlink")
pytest.importorskip("jsbsim", reason="the aeroplane flies in JSBSim: pip install 'eadp[bench]'")

from common.console import Console

ROOT = Path(__file__).resolve().parents[1]
TUTORIAL = (ROOT / "docs/tutorial.md").read_text()


def command(start, port):
    """The tutorial's command that starts so, on a free port and twice as fast."""
    section = TUTORIAL[TUTORIAL.index("## 7.") :].replace("\\\n", " ")
    (line,) = re.findall(rf"^{re.escape(start)}.*", section, re.M)
    words = shlex.split(line.split(" > ")[0].replace("14550", str(port)).replace("--speed 10", "--speed 20"))
    return [sys.executable, "-m", *words] if words[0] == "eadp" else [sys.executable, str(ROOT / words[1]), *words[2:]]


def prepared(folder):
    """The tutorial's files, plan and mission in a folder, a free port, and what runs a command there."""
    console = Console(folder)
    console.write_files(TUTORIAL)
    (cover,) = re.findall(r"^\$ (eadp cover plans/meadow.geojson --wind.*)", TUTORIAL.replace("\\\n", " "), re.M)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def run(words, **options):
        return subprocess.run(words, cwd=console.folder, capture_output=True, text=True, check=True, **options)

    run([sys.executable, "-m", *shlex.split(cover)])
    run(command("eadp export", port))
    return console, port, run


def flown(folder, *more):
    """A flight beside the planner: its files' folder, both ends' words, and what runs another command there."""
    console, port, run = prepared(folder)
    out, err = folder / "out.jsonl", folder / "err.txt"
    with (
        out.open("w") as stdout,
        err.open("w") as stderr,
        subprocess.Popen(command("eadp replan", port), cwd=console.folder, stdout=stdout, stderr=stderr) as planner,
    ):
        while f":{port:04X} " not in Path("/proc/net/udp").read_text():
            assert planner.poll() is None
            time.sleep(0.05)
        words = [*command("python docs/examples/vehicle.py", port), "--to", f"127.0.0.1:{port}", *more]
        vehicle = run(words, timeout=300)
        planner.wait(60)
    said = err.read_text()
    assert planner.returncode in (0, 1), said
    assert json.loads(vehicle.stdout)["completed"]
    assert "holds the mission of --items" in said
    return planner.returncode, vehicle, said, out, port, run


@pytest.mark.slow
def test_the_flight_of_the_tutorial(tmp_path):
    code, vehicle, said, out, port, run = flown(tmp_path)
    assert code == 0, said
    assert "eadp: spacing" in vehicle.stderr
    assert "uploaded and verified" in said
    again = [word for word in command("eadp replan", port) if word not in ("--log", "my-field/live.jsonl", "--upload")]
    again[again.index("--mavlink") : again.index("--mavlink") + 2] = ["--replay", "my-field/live.jsonl"]
    assert run(again).stdout == out.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    "rough", [("--take-off", "10"), ("--loss", "0.05", "--delay", "0.05"), ("--cell", "60", "0.1")], ids="-".join
)
def test_a_flight_as_rough_as_a_real_one(tmp_path, rough):
    """The vehicle leaves waypoints as ArduPlane does; nothing that it does stops the planner, or an upload halfway."""
    _, vehicle, said, *_ = flown(tmp_path, *rough)
    assert "Traceback" not in said
    # an upload that is begun is verified, refused or sent again: no mission is left unknown
    assert "unknown after an upload" not in said
    if json.loads(vehicle.stdout)["items_written"]:  # where the machine is slow, and answers late, it is read again
        assert "uploaded and verified" in said or "read again each" in said
