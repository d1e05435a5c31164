#!/usr/bin/env python3
"""A detector of ROS 1 that obeys, to copy: it looks at the rate decided, and says once a second which it reaches."""

import time

import rospy
from std_msgs.msg import Float64


def look() -> None:
    """Look at a picture; here only the rate counts."""


def main() -> None:
    rospy.init_node("detector")
    name, asked = rospy.get_param("~name"), {"rate": float(rospy.get_param("~rate", 2.0))}
    reached = rospy.Publisher(f"eadp/reached/{name}", Float64, queue_size=1)
    rospy.Subscriber(f"eadp/rate/{name}", Float64, lambda message: asked.update(rate=message.data))
    started = due = time.monotonic()
    count = 0
    while not rospy.is_shutdown():
        look()
        count += 1
        now = time.monotonic()
        if now - started >= 1:
            reached.publish(count / (now - started))
            started, count = now, 0
        due = max(due + 1 / asked["rate"], now)
        time.sleep(due - now)


if __name__ == "__main__":
    main()
