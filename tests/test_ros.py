"""The nodes of ros/ on a recorded flight: that of ROS 1 under the real one, that of ROS 2 beside stand-ins."""

import csv
import importlib.util
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from common import ROOT
from common.plans import placed_survey

from eadp.cli.main import main
from eadp.exchange.writer import read_items

NODES, PACKAGES = ROOT / "ros/nodes", "/usr/lib/python3/dist-packages"
STEPS, LOST_S = 90, 45.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A folder with a plan, a scenario, the mission's items, and a flight on them second by second, as JSON lines.

    The computer takes much of the power, and the battery loses a part of its charge on the way.
    """
    folder = tmp_path_factory.mktemp("ros")
    plan = str(placed_survey(folder))
    (folder / "detector.csv").write_text("fps,power_w\n2,2\n10,30\n")
    assert main(["profile", str(folder / "detector.csv"), "-o", str(folder / "detector.yaml")]) == 0
    text = (ROOT / "scenarios/survey.yaml").read_text()
    (folder / "scenario.yaml").write_text(text.replace("../profiles/pednet-jetson-nano.yaml", "detector.yaml"))
    given = [plan, "--scenario", str(folder / "scenario.yaml"), "--planner", "static"]
    assert main(["simulate", *given, "-o", str(folder / "flown")]) in (0, 1)
    assert main(["export", plan, "--to", "ardupilot", "--altitude", "25", "-o", str(folder / "mission.waypoints")]) == 0
    items, started, before = read_items(str(folder / "mission.waypoints.items.json"), ("c1",)), 0, 0
    with (folder / "flown/flight.csv").open() as stream, (folder / "flight.jsonl").open("w") as out:
        for row in [*csv.DictReader(stream)][: 10 * STEPS]:
            started, before = started + (int(row["stage"]) != before), int(row["stage"])
            if float(row["time_s"]) % 1 < 0.05:
                lost = 0.25 if float(row["time_s"]) > LOST_S else 0.0
                line = {key: float(row[key]) for key in ("time_s", "lat_deg", "lon_deg", "altitude_m", "power_w")}
                item = next(i for i, each in enumerate(items) if each.last >= started)
                out.write(json.dumps({**line, "soc": float(row["soc"]) - lost, "item": item + 1, "stage": before}))
                out.write("\n")
    waypoints = [
        dict(zip(("frame", "param1", "param2", "param3", "param4", "x_lat", "y_long", "z_alt"), values, strict=True))
        | {"command": each.item.command}
        for each in items
        for values in ((each.item.frame, *each.item.parameters),)
    ]
    (folder / "waypoints.json").write_text(json.dumps([waypoints[0], *waypoints]))  # ArduPilot's after home
    return folder


def messages(folder, kinds, stamp):
    """What MAVROS says, second by second: topics and messages, the fix last."""
    waypoints = [kinds["Waypoint"](**each) for each in json.loads((folder / "waypoints.json").read_text())]
    for line in map(json.loads, (folder / "flight.jsonl").read_text().splitlines()):
        yield "mavros/state", kinds["State"](mode="AUTO", armed=True, system_status=4)
        yield "mavros/extended_state", kinds["ExtendedState"](landed_state=2)
        yield "mavros/mission/waypoints", kinds["WaypointList"](current_seq=line["item"], waypoints=waypoints)
        current = -line["power_w"] / 15
        yield "mavros/battery", kinds["BatteryState"](voltage=15.0, current=current, percentage=line["soc"])
        yield "mavros/global_position/rel_alt", kinds["Float64"](data=line["altitude_m"])
        fix = kinds["NavSatFix"](latitude=line["lat_deg"], longitude=line["lon_deg"])
        fix.header.stamp, fix.status.status = stamp(line["time_s"]), 0
        yield "mavros/global_position/global", fix


# ROS 2


class Message(SimpleNamespace):
    """Stands for a message of ROS 2."""

    def __init__(self, **values):
        super().__init__(header=SimpleNamespace(), status=SimpleNamespace(), **values)


def stand_ins(spin, parameters):
    """The modules that the node of ROS 2 imports; `spin` is called with its subscriptions and what it published."""
    published, taken = [], {}

    class Node:
        def declare_parameter(self, name, default):
            return SimpleNamespace(value=parameters.get(name, default))

        def create_publisher(self, kind, topic, quality):
            return SimpleNamespace(publish=lambda message: published.append((topic, message.data)))

        def create_subscription(self, kind, topic, take, quality):
            taken[topic] = take

        def get_logger(self):
            return SimpleNamespace(warning=print, fatal=print)

    modules = {name: ModuleType(name) for name in ("rclpy", "rclpy.qos", "sensor_msgs", "mavros_msgs", "std_msgs")}
    vars(modules["rclpy"]).update(
        init=lambda: None, create_node=lambda _: Node(), spin=lambda _: spin(taken, published)
    )
    vars(modules["rclpy.qos"]).update(
        DurabilityPolicy=SimpleNamespace(TRANSIENT_LOCAL=1), QoSProfile=lambda **_: None, qos_profile_sensor_data=None
    )
    for package in ("sensor_msgs", "mavros_msgs", "std_msgs"):
        modules[f"{package}.msg"] = ModuleType(f"{package}.msg")
        names = "BatteryState", "NavSatFix", "State", "ExtendedState", "WaypointList", "Float64", "String"
        vars(modules[f"{package}.msg"]).update(dict.fromkeys(names, Message))
    return modules


def run_node(monkeypatch, spin, parameters):
    """Run the node of ROS 2 on stand-ins."""
    monkeypatch.syspath_prepend(str(NODES))
    for name, module in stand_ins(spin, parameters).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "core", raising=False)
    spec = importlib.util.spec_from_file_location("ros2", NODES / "ros2.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main()


def given_files(folder):
    """Parameters of a node."""
    names = {"plan": "survey.plan", "scenario": "scenario.yaml", "items": "mission.waypoints.items.json"}
    return {name: str(folder / file) for name, file in names.items()}


def test_the_node_of_ros_2_decides(flight, tmp_path, monkeypatch):
    """Beside stand-ins for rclpy and the messages; the core is the one that ROS 1 has."""
    got = []

    def spin(taken, published):
        def stamp(time_s):
            return SimpleNamespace(sec=1_700_000_000 + int(time_s), nanosec=0)

        for k, (topic, message) in enumerate(messages(flight, dict.fromkeys(KINDS, Message), stamp)):
            taken[topic](message)
            if k == 1:
                taken["mavros/battery"](Message(voltage=0.0, current=float("nan"), percentage=float("nan")))
                taken["mavros/state"](Message(mode="", armed=False, system_status=0))
            if message.__dict__.get("latitude") and published:
                rate = next(value for topic, value in reversed(published) if topic == "eadp/rate/fps")
                taken["eadp/reached/fps"](Message(data=rate))
        got.extend(published)

    run_node(monkeypatch, spin, {**given_files(flight), "log": str(tmp_path / "flight.log")})
    lines = [json.loads(value) for topic, value in got if topic == "eadp/decision"]
    rates = [value for topic, value in got if topic == "eadp/rate/fps"]
    assert len(lines) == len(rates) > STEPS / 2
    assert rates[0] == 10.0
    assert rates[-1] < 10.0
    assert lines[-1]["in_force"]["c2"] == rates[-1]
    flown = {json.loads(line)["stage"] for line in (flight / "flight.jsonl").read_text().splitlines()}
    assert {line["stage"] for line in lines} == flown
    assert len(flown) == 4
    keys = "lat_deg", "lon_deg", "power_w", "soc", "altitude_m"
    played = [json.loads(line) for line in (flight / "flight.jsonl").read_text().splitlines()]
    logged = [
        line
        for line in map(json.loads, (tmp_path / "flight.log").read_text().splitlines())
        if line["kind"] == "telemetry"
    ]
    for ours, theirs in zip(logged[-STEPS + 1 :], played[-STEPS + 1 :], strict=True):
        assert [ours[key] for key in keys] == pytest.approx([theirs[key] for key in keys], abs=1e-4)
    assert not any("stage-unknown" in line["warnings"] for line in lines)


def test_a_node_refuses_bad_files(flight, monkeypatch, capsys):
    with pytest.raises(SystemExit) as ended:
        run_node(monkeypatch, None, {**given_files(flight), "plan": "absent.plan"})
    assert ended.value.code == 2
    assert "absent.plan:1:1: error: " in capsys.readouterr().out


KINDS = "Waypoint", "State", "ExtendedState", "WaypointList", "BatteryState", "Float64", "NavSatFix"


# ROS 1

MAVROS = """
from genpy.dynamic import generate_dynamic
LINE = 80 * "=" + "\\n"
HEADER = LINE + "MSG: std_msgs/Header\\nuint32 seq\\ntime stamp\\nstring frame_id\\n"
NUMBERS = "".join(f"float32 param{i}\\n" for i in range(1, 5)) + "float64 x_lat\\nfloat64 y_long\\nfloat64 z_alt\\n"
KIND = "uint8 frame\\nuint16 command\\nbool is_current\\nbool autocontinue\\n"
ITEM = LINE + "MSG: mavros_msgs/Waypoint\\n" + KIND + NUMBERS
STATE = "bool connected\\nbool armed\\nbool guided\\nbool manual_input\\nstring mode\\nuint8 system_status\\n"
FIELDS = {
    "State": "std_msgs/Header header\\n" + STATE + HEADER,
    "ExtendedState": "std_msgs/Header header\\nuint8 vtol_state\\nuint8 landed_state\\n" + HEADER,
    "WaypointList": "uint16 current_seq\\nmavros_msgs/Waypoint[] waypoints\\n" + ITEM,
}
for name, fields in FIELDS.items():
    made = generate_dynamic(f"mavros_msgs/{name}", fields)
    globals()[name] = made[f"mavros_msgs/{name}"]
Waypoint = made["mavros_msgs/Waypoint"]
"""
"""The messages of MAVROS that the node reads, by their definitions; Debian has no package of them."""

PLAYER = """
import json, sys, time
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/support"]
import rospy, test_ros
from pathlib import Path
from mavros_msgs.msg import ExtendedState, State, Waypoint, WaypointList
from sensor_msgs.msg import BatteryState, NavSatFix
from std_msgs.msg import Float64, String

rospy.init_node("player")
decisions, rates, reached = [], [], []
rospy.Subscriber("eadp/decision", String, lambda m: decisions.append(json.loads(m.data)))
rospy.Subscriber("eadp/rate/fps", Float64, lambda m: rates.append(m.data))
rospy.Subscriber("eadp/reached/fps", Float64, lambda m: reached.append(m.data))
kinds = {name: globals()[name] for name in test_ros.KINDS}

def wait(met, what, at_most_s=60):
    until = time.monotonic() + at_most_s
    while not met():
        if time.monotonic() > until:
            sys.exit(f"waited for {what}: {decisions[-1:]} {rates[-3:]} {reached[-3:]}")
        time.sleep(0.01)

followed, publishers = [], {}
for topic, message in test_ros.messages(Path(sys.argv[2]), kinds, lambda time_s: rospy.Time(1_700_000_000 + time_s)):
    if topic not in publishers:
        publishers[topic] = rospy.Publisher(topic, type(message), queue_size=100)
        recorded = topic in ("mavros/battery", "mavros/global_position/global")
        wait(lambda: publishers[topic].get_num_connections() > recorded, topic)
        time.sleep(0.2)
    if hasattr(message, "header") and topic != "mavros/global_position/global":
        message.header.stamp = rospy.Time(0)
    before = len(decisions)
    publishers[topic].publish(message)
    time.sleep(0.005)
    if topic == "mavros/global_position/global":
        until = time.monotonic() + 5
        while len(decisions) == before and time.monotonic() < until:
            time.sleep(0.005)
        if rates and (not followed or rates[-1] != followed[-1][0]):  # the detector follows, and is heard
            count = len(reached)
            wait(lambda: len(reached) > count and abs(reached[-1] - rates[-1]) < 0.2 * rates[-1], "the detector")
            followed.append((rates[-1], reached[-1]))
count = len(reached)
wait(lambda: len(reached) > count, "the detector")
print(json.dumps({"decisions": decisions, "followed": followed}))
"""

LAUNCH = """
<launch>
  <include file="{package}/launch/replan.launch">
    <arg name="plan" value="{plan}"/>
    <arg name="scenario" value="{scenario}"/>
    <arg name="items" value="{items}"/>
    <arg name="log" value="{folder}/flight.log"/>
    <arg name="python" value="{python}"/>
  </include>
  <node pkg="eadp_ros" type="detector1.py" name="detector" launch-prefix="{python}" output="screen">
    <param name="name" value="fps"/>
  </node>
</launch>
"""


def interrupt(process):
    """End a process as Ctrl+C does, and wait for it."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(30)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_detector_follows_the_node_of_ros_1(flight, tmp_path, capsys):
    """roslaunch with a master, the node and a detector; a flight played as topics, recorded by rosbag, and fitted."""
    if shutil.which("roslaunch") is None or not Path(PACKAGES, "sensor_msgs").exists():
        pytest.skip("ROS 1 is not installed: apt install ros-core python3-rospy python3-sensor-msgs")
    modules = tmp_path / "modules"
    (modules / "mavros_msgs").mkdir(parents=True)
    (modules / "mavros_msgs/__init__.py").touch()
    (modules / "mavros_msgs/msg.py").write_text(MAVROS)
    # Debian's modules come after those of this environment
    (modules / "sitecustomize.py").write_text(f"import sys\nsys.path.append({PACKAGES!r})\n")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    env = {
        **os.environ, "PYTHONPATH": os.pathsep.join([str(modules), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "ROS_HOME": str(tmp_path),
        "ROS_PACKAGE_PATH": f"{ROOT / 'ros'}:/usr/share",
    }  # fmt: skip
    launch, log = tmp_path / "test.launch", (tmp_path / "launch.log").open("w")
    given = {**given_files(flight), "folder": tmp_path, "package": ROOT / "ros", "python": sys.executable}
    launch.write_text(LAUNCH.format(**given))
    started = [subprocess.Popen(["roslaunch", "-p", port, str(launch)], env=env, stdout=log, stderr=log)]
    try:
        until = time.monotonic() + 60
        while not (tmp_path / "flight.log").exists():
            assert started[0].poll() is None, (tmp_path / "launch.log").read_text()
            assert time.monotonic() < until
            time.sleep(0.1)
        topics = ["/mavros/battery", "/mavros/global_position/global"]
        record = ["rosbag", "record", "-O", str(tmp_path / "flight.bag"), *topics]
        started.append(subprocess.Popen(record, env=env, stdout=log, stderr=log))
        player = [sys.executable, "-c", PLAYER, str(Path(__file__).parent), str(flight)]
        done = subprocess.run(player, env=env, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr + (tmp_path / "launch.log").read_text()
    finally:
        for process in reversed(started):
            interrupt(process)
        log.close()
    result = json.loads(done.stdout.splitlines()[-1])
    rates = [rate for rate, _ in result["followed"]]
    assert rates[0] == 10.0
    assert rates[-1] < 10.0
    assert all(abs(reached - rate) < 0.2 * rate for rate, reached in result["followed"])
    last = result["decisions"][-1]
    assert last["in_force"]["c2"] == pytest.approx(rates[-1], rel=0.2)  # as the detector says
    assert len(result["decisions"]) > STEPS / 2
    assert not any("stage-unknown" in line["warnings"] for line in result["decisions"])
    # the log has the flight: it is replayed to the same end
    capsys.readouterr()
    assert main(["fit", str(tmp_path / "flight.bag"), "--format", "json"]) in (0, 1)
    fitted = json.loads(capsys.readouterr().out)
    assert fitted["log"]["rows"] == STEPS
