"""ROS 2: ros2 launch eadp_ros replan.launch.py plan:=/etc/eadp/survey.plan scenario:=/etc/eadp/scenario.yaml"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

NAMES = "plan", "scenario", "items", "log"


def generate_launch_description() -> LaunchDescription:
    share = Path(__file__).resolve().parents[1]
    node = next(path for path in (share / "nodes/ros2.py", share.parents[1] / "lib/eadp_ros/ros2.py") if path.exists())
    parameters = [word for name in NAMES for word in ("-p", [f"{name}:='", LaunchConfiguration(name), "'"])]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name) for name in NAMES[:2]),
            *(DeclareLaunchArgument(name, default_value="") for name in NAMES[2:]),
            DeclareLaunchArgument("python", default_value="/opt/eadp/bin/python"),
            ExecuteProcess(cmd=[LaunchConfiguration("python"), str(node), "--ros-args", *parameters], output="screen"),
        ]
    )
