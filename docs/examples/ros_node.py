"""Feeds eadp replan from MAVROS, and publishes its decisions."""

import json
from functools import partial
from subprocess import PIPE, Popen
from threading import Thread

import rclpy
from geometry_msgs.msg import TwistStamped
from mavros_msgs.msg import ExtendedState
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import BatteryState, NavSatFix
from std_msgs.msg import String

EADP = ["/opt/eadp/bin/eadp", "replan", "/etc/eadp/survey.plan", "--scenario", "/etc/eadp/scenario.yaml"]
TOPICS = {
    ExtendedState: "extended_state",
    BatteryState: "battery",
    NavSatFix: "global_position/global",
    TwistStamped: "local_position/velocity_local",
}


def tell():
    if not TOPICS.keys() <= latest.keys() or latest[ExtendedState].landed_state < ExtendedState.LANDED_STATE_IN_AIR:
        return
    fix, battery, speed = latest.pop(NavSatFix), latest[BatteryState], latest[TwistStamped].twist.linear  # x east
    stamp, soc, power_w = (
        fix.header.stamp,
        battery.percentage,
        -battery.voltage * battery.current,
    )  # discharge is below 0
    line = {
        "time_s": stamp.sec + stamp.nanosec * 1e-9,
        "lat_deg": fix.latitude,
        "lon_deg": fix.longitude,
        "power_w": power_w if power_w >= 0 else None,
        "soc": soc if soc >= 0 else None,  # NaN where unknown
        "velocity_mps": [speed.x, speed.y],
    }
    if fix.status.status >= 0:
        print(json.dumps(line), file=process.stdin, flush=True)


def publish():
    for line in process.stdout:
        decisions.publish(String(data=line))


rclpy.init()
node, latest = rclpy.create_node("eadp"), {}
process = Popen(EADP, stdin=PIPE, stdout=PIPE, text=True)
decisions = node.create_publisher(String, "eadp/decision", 10)
for kind, topic in TOPICS.items():
    node.create_subscription(kind, f"/mavros/{topic}", partial(latest.__setitem__, kind), qos_profile_sensor_data)
node.create_timer(0.2, tell)
Thread(target=publish, daemon=True).start()
rclpy.spin(node)
