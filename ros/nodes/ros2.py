#!/usr/bin/env python3
"""The node of ROS 2."""

import importlib
import sys

import rclpy
from core import Core, InputError
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from std_msgs.msg import Float64, String


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("eadp")
    given = {name: node.declare_parameter(name, "").value for name in ("plan", "scenario", "items", "log")}
    decisions, rates = node.create_publisher(String, "eadp/decision", 10), {}
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # for one that starts later
    log = node.get_logger()

    def rate(name: str, value: float) -> None:
        if name not in rates:
            rates[name] = node.create_publisher(Float64, f"eadp/rate/{name}", kept)
        rates[name].publish(Float64(data=value))

    try:
        core = Core(given, lambda text: decisions.publish(String(data=text)), rate, log.warning)
    except InputError as error:
        log.fatal(str(error))
        sys.exit(2)
    for topic, (module, kind, take) in core.topics.items():
        quality = kept if topic == "mavros/mission/waypoints" else qos_profile_sensor_data
        node.create_subscription(getattr(importlib.import_module(module), kind), topic, take, quality)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
