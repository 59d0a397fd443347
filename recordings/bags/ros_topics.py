"""ROS topics shared by the chair's nodes and its bags: names, types, frames and QoS as Nav2, RViz and Foxglove expect.

Names are relative, so that namespaces and remapping work; names with a leading slash are absolute, as in tf2_ros.
Nominal rates, and with them the age at which an input is stale, come from `waychair.topics`.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair import topics
from waychair.recordings.bags.ros_messages import (
    IMU_FRAME,
    LASER_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    OPTICAL_FRAME,
    SONAR_FRAME,
)
from waychair.topics import Topic


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service: kept for late subscribers (`latched`, transient local), resent when lost (`reliable`)."""

    depth: int = 10
    reliable: bool = True
    latched: bool = False


SENSOR_DATA = Qos(5, reliable=False)
RELIABLE = Qos()
LATCHED = Qos(1, latched=True)


@dataclass(frozen=True, slots=True)
class RosTopic:
    """One topic: its name, type (package/msg/Name), QoS, the frame of its headers, and the stream that it carries."""

    name: str
    type: str
    qos: Qos = RELIABLE
    frame: str = ""
    stream: Topic | None = None

    @property
    def rate_hz(self) -> float:
        """Return the nominal rate; 0 for messages that are sent on change."""
        return 0.0 if self.stream is None else self.stream.rate_hz

    @property
    def absolute(self) -> str:
        """Return the name outside of any namespace, as in a bag."""
        return self.name if self.name.startswith("/") else f"/{self.name}"


SCAN = RosTopic("scan", "sensor_msgs/msg/LaserScan", SENSOR_DATA, LASER_FRAME, topics.SCAN)
IMU = RosTopic("imu/data", "sensor_msgs/msg/Imu", SENSOR_DATA, IMU_FRAME, topics.IMU)
PRESSURE = RosTopic("pressure", "sensor_msgs/msg/FluidPressure", SENSOR_DATA, IMU_FRAME, topics.PRESSURE)
JOINTS = RosTopic("joint_states", "sensor_msgs/msg/JointState", RELIABLE, "", topics.WHEELS)
ODOMETRY = RosTopic("odom", "nav_msgs/msg/Odometry", RELIABLE, ODOM_FRAME, topics.ODOMETRY)
COLOUR = RosTopic("camera/color/image_raw", "sensor_msgs/msg/Image", SENSOR_DATA, OPTICAL_FRAME, topics.CAMERA)
COLOUR_INFO = RosTopic(
    "camera/color/camera_info", "sensor_msgs/msg/CameraInfo", SENSOR_DATA, OPTICAL_FRAME, topics.CAMERA
)
DEPTH = RosTopic(
    "camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image", SENSOR_DATA, OPTICAL_FRAME, topics.CAMERA
)
DEPTH_INFO = RosTopic(
    "camera/aligned_depth_to_color/camera_info", "sensor_msgs/msg/CameraInfo", SENSOR_DATA, OPTICAL_FRAME, topics.CAMERA
)
"""The camera topics have the names of RealSense drivers with depth aligned to colour, as in RTAB-Map's examples."""

TRUTH = RosTopic("ground_truth/odom", "nav_msgs/msg/Odometry", RELIABLE, MAP_FRAME, topics.ODOMETRY)
"""The true pose of the simulated chair, for scoring; a node that drives must not subscribe to it."""

TF = RosTopic("/tf", "tf2_msgs/msg/TFMessage", Qos(100))
TF_STATIC = RosTopic("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)


def sonar(index: int) -> RosTopic:
    """Return the topic of one sonar, named after its frame, since no part of a topic name may begin with a digit."""
    frame = SONAR_FRAME.format(index)
    return RosTopic(frame, "sensor_msgs/msg/Range", SENSOR_DATA, frame, topics.SONAR)
