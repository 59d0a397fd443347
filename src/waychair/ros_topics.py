"""What a chair's nodes and its bags have in common: topics' names, types, frames and QoS, as Nav2, RViz and Foxglove
users expect them.

Names are relative, so that a namespace and remapping work; those with a slash are absolute for everybody (tf2_ros names
them so). Rates, and with them the age at which an input is stale, are those of `waychair.topics`.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair import topics
from waychair.ros_messages import IMU_FRAME, LASER_FRAME, MAP_FRAME, ODOM_FRAME, OPTICAL_FRAME, SONAR_FRAME
from waychair.topics import Topic


@dataclass(frozen=True, slots=True)
class Qos:
    """How messages travel: kept for late subscribers (`latched`) or not, resent when lost (`reliable`) or not."""

    depth: int = 10
    reliable: bool = True
    latched: bool = False


SENSOR_DATA = Qos(5, reliable=False)
RELIABLE = Qos()
LATCHED = Qos(1, latched=True)


@dataclass(frozen=True, slots=True)
class RosTopic:
    """One topic: its name, type (as package/msg/Name), QoS, the frame of its headers, and what it carries, if a noun."""

    name: str
    type: str
    qos: Qos = RELIABLE
    frame: str = ""
    carries: Topic | None = None

    @property
    def rate_hz(self) -> float:
        """Nominal rate; 0 for what is sent when it changes."""
        return 0.0 if self.carries is None else self.carries.rate_hz

    @property
    def absolute(self) -> str:
        """The name outside of any namespace, as it is in a bag."""
        return self.name if self.name.startswith("/") else f"/{self.name}"


SCAN = RosTopic("scan", "sensor_msgs/msg/LaserScan", SENSOR_DATA, LASER_FRAME, topics.SCAN)
IMU = RosTopic("imu/data", "sensor_msgs/msg/Imu", SENSOR_DATA, IMU_FRAME, topics.IMU)
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
"""The camera's are the names of RealSense drivers with depth aligned to colour, which RTAB-Map's examples take."""

TRUTH = RosTopic("ground_truth/odom", "nav_msgs/msg/Odometry", RELIABLE, MAP_FRAME, topics.ODOMETRY)
"""Where the simulated chair really is: for scores; a stack must not take it."""

TF = RosTopic("/tf", "tf2_msgs/msg/TFMessage", Qos(100))
TF_STATIC = RosTopic("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)


def sonar(index: int) -> RosTopic:
    """The topic of one sonar, named after its frame: no part of a topic's name may begin with a digit."""
    frame = SONAR_FRAME.format(index)
    return RosTopic(frame, "sensor_msgs/msg/Range", SENSOR_DATA, frame, topics.SONAR)
