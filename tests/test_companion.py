"""The ROS 2 node of docs/examples, run against stand-ins for rclpy and its messages, with a real `eadp replan`."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import sys
import threading
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from common.plans import ORIGIN, placed_survey

from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_geodetic_deg

ROOT = Path(__file__).resolve().parents[1]
LINES = [json.loads(line) for line in (ROOT / "scenarios/example-telemetry.jsonl").read_text().splitlines()[:40]]


class Message(SimpleNamespace):
    """Stands for a message of ROS."""


class Publisher:
    """Keeps what is published, and says when so many have come."""

    def __init__(self):
        self.got, self.count, self.complete = [], 0, threading.Event()

    def publish(self, message):
        self.got.append(json.loads(message.data))
        if len(self.got) == self.count:
            self.complete.set()


class Node:
    """Stands for rclpy's node."""

    def __init__(self, name):
        self.topics, self.publisher, self.timers = {}, Publisher(), []

    def create_timer(self, period_s, call):
        assert period_s == 0.2
        self.timers.append(call)

    def create_publisher(self, kind, topic, depth):
        assert (kind, topic, depth) == (MESSAGES["String"], "eadp/decision", 10)
        return self.publisher

    def create_subscription(self, kind, topic, take, qos):
        assert qos == "best effort"
        self.topics[kind] = take


def kind(name, **values):
    return type(name, (Message,), values)


MESSAGES = {
    name: kind(name) for name in ("TwistStamped", "BatteryState", "NavSatFix", "String")
} | {"ExtendedState": kind("ExtendedState", LANDED_STATE_IN_AIR=2)}  # fmt: skip


def modules(spin):
    """The modules that the node imports."""
    ros = {name: ModuleType(name) for name in ("rclpy", "rclpy.qos")}
    ros["rclpy"].init, ros["rclpy"].spin, ros["rclpy"].create_node = lambda: None, spin, Node
    ros["rclpy.qos"].qos_profile_sensor_data = "best effort"
    for package in ("geometry_msgs", "mavros_msgs", "sensor_msgs", "std_msgs"):
        ros[package], ros[f"{package}.msg"] = ModuleType(package), ModuleType(f"{package}.msg")
        vars(ros[f"{package}.msg"]).update(MESSAGES)
    return ros


def test_the_node_of_the_page_runs(tmp_path, monkeypatch):
    placed_survey(tmp_path)
    source = (ROOT / "docs/examples/ros_node.py").read_text()
    names = {"/opt/eadp/bin/eadp": "-m", "/etc/eadp/survey.plan": str(tmp_path / "survey.plan")}
    names["/etc/eadp/scenario.yaml"] = str(ROOT / "scenarios/survey.yaml")
    for name, own in names.items():
        assert name in source
        source = source.replace(f'"{name}"', f'"{sys.executable}", "-m", "eadp"' if own == "-m" else f'"{own}"')
    before, names_of_node = {*threading.enumerate()}, {"__name__": "node"}

    def spin(node):
        node.publisher.count = len(LINES)

        def send(name, **values):
            node.topics[MESSAGES[name]](MESSAGES[name](**values))

        (tell,) = node.timers
        for line in LINES:
            send("BatteryState", voltage=12.0, current=-line["power_w"] / 12, percentage=line["soc"])
            x, y = line["velocity_mps"]
            send("TwistStamped", twist=Message(linear=Message(x=x, y=y)))
            latitude, longitude = to_geodetic_deg(line["x_m"], line["y_m"], ORIGIN)
            stamp = Message(sec=1_700_000_000 + int(line["time_s"]), nanosec=0)
            place = {"header": Message(stamp=stamp), "latitude": latitude, "longitude": longitude}
            if line is LINES[0]:
                tell()  # not all is known
                send("ExtendedState", landed_state=1)
                send("NavSatFix", status=Message(status=0), **place)
                tell()  # on the ground
                send("ExtendedState", landed_state=2)
                send("NavSatFix", status=Message(status=-1), **place)
                tell()  # no position
            send("NavSatFix", status=Message(status=0), **place)
            tell()
            tell()  # nothing new
        assert node.publisher.complete.wait(60)
        process = names_of_node["process"]
        process.stdin.close()
        assert process.wait(60) in (0, 1)
        for thread in {*threading.enumerate()} - before:
            thread.join(60)
        process.stdout.close()

    for name, module in modules(spin).items():
        monkeypatch.setitem(sys.modules, name, module)
    exec(compile(source, "docs/examples/ros_node.py", "exec"), names_of_node)
    published = names_of_node["node"].publisher.got
    assert len(published) == len(LINES)
    assert published[-1]["parameters"]["c1"] < 0
    assert published[-1]["soc_end_forecast"] is not None


def test_the_vehicle_flies_the_mission_that_the_page_exports(tmp_path, monkeypatch):
    """With the pack asked for; home before the mission's last item it has not completed it."""
    pytest.importorskip("jsbsim", reason="the aeroplane flies in JSBSim: pip install 'eadp[bench]'")
    placed_survey(tmp_path).rename(tmp_path / "desk.plan")
    (export,) = re.findall(r"^(eadp export .*)$", (ROOT / "docs/companion.md").read_text(), re.M)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(export)[1:]) == 0
    spec = importlib.util.spec_from_file_location("vehicle", ROOT / "docs/examples/vehicle.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    vehicle = module.Vehicle(tmp_path / "desk.waypoints", (0.0, 0.0), 1.3, 0, cells=6)
    vehicle.step()
    assert 6 * 3.9 < vehicle.pack.voltage_v < 6 * 4.2
    vehicle.pilot.mode, vehicle.pilot.done = "return", True
    assert not vehicle.completed
    vehicle.holder.current = len(vehicle.holder.items)
    assert vehicle.completed
