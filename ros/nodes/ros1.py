#!/usr/bin/env python3
"""The node of ROS 1."""

import importlib
import sys

import rospy
from core import Core, InputError
from std_msgs.msg import Float64, String


def main() -> None:
    rospy.init_node("eadp")
    given = {name: str(rospy.get_param(f"~{name}", "")) for name in ("plan", "scenario", "items", "log")}
    decisions, rates = rospy.Publisher("eadp/decision", String, queue_size=10), {}

    def rate(name: str, value: float) -> None:
        if name not in rates:  # latched: a detector that starts later has the rate
            rates[name] = rospy.Publisher(f"eadp/rate/{name}", Float64, queue_size=1, latch=True)
        rates[name].publish(value)

    try:
        core = Core(given, decisions.publish, rate, rospy.logwarn)
    except InputError as error:
        rospy.logfatal(str(error))
        sys.exit(2)
    for topic, (module, kind, take) in core.topics.items():
        rospy.Subscriber(topic, getattr(importlib.import_module(module), kind), take)
    rospy.spin()


if __name__ == "__main__":
    main()
