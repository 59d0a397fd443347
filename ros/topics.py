"""What the chair's nodes publish and take: names, types, frames and QoS as Nav2, RViz and Foxglove users expect them.

Names are relative, so that a namespace and remapping work; those with a slash are absolute for everybody (tf2_ros,
diagnostic_updater and rclcpp name them so), and Nav2's launch files remap them. Rates, and with them the age at which an
input is stale, are those of `waychair.topics`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from waychair import topics
from waychair.ros_messages import BASE_FRAME, IMU_FRAME, LASER_FRAME, MAP_FRAME, ODOM_FRAME, OPTICAL_FRAME, SONAR_FRAME
from waychair.topics import Topic


@dataclass(frozen=True, slots=True)
class Qos:
    """How messages travel: kept for late subscribers (`latched`) or not, resent when lost (`reliable`) or not."""

    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def profile(self) -> Any:
        """rclpy's QoSProfile."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        return QoSProfile(
            depth=self.depth,
            reliability=ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE,
        )


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
JOY = RosTopic("joy", "sensor_msgs/msg/Joy", SENSOR_DATA, "", topics.JOYSTICK)
BATTERY = RosTopic("battery_state", "sensor_msgs/msg/BatteryState", RELIABLE, "", topics.STATUS)
TRUTH = RosTopic("ground_truth/odom", "nav_msgs/msg/Odometry", RELIABLE, MAP_FRAME, topics.ODOMETRY)
"""Where the simulated chair really is: for scores; a stack must not take it."""

MAP = RosTopic("map", "nav_msgs/msg/OccupancyGrid", LATCHED, MAP_FRAME, topics.MAP)
PLAN = RosTopic("plan", "nav_msgs/msg/Path", RELIABLE, MAP_FRAME, topics.PLAN)
LOCAL_PLAN = RosTopic("local_plan", "nav_msgs/msg/Path", RELIABLE, MAP_FRAME)
GLOBAL_COSTMAP = RosTopic("global_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED, MAP_FRAME)
LOCAL_COSTMAP = RosTopic("local_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED, ODOM_FRAME)
FOOTPRINT = RosTopic("local_costmap/published_footprint", "geometry_msgs/msg/PolygonStamped", RELIABLE, ODOM_FRAME)
COMMAND = RosTopic("cmd_vel", "geometry_msgs/msg/Twist", RELIABLE, BASE_FRAME, topics.COMMAND)
STAMPED_COMMAND = RosTopic("cmd_vel", "geometry_msgs/msg/TwistStamped", RELIABLE, BASE_FRAME, topics.COMMAND)
"""The same name with a stamp, for those who set `enable_stamped_cmd_vel`, as in Nav2."""

GOAL = RosTopic("goal_pose", "geometry_msgs/msg/PoseStamped", RELIABLE, MAP_FRAME, topics.GOAL)
INITIAL_POSE = RosTopic("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", RELIABLE, MAP_FRAME)
POSE = RosTopic("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED, MAP_FRAME)
"""Named after Nav2's localiser, since scripts wait for it."""

SPEED_LIMIT = RosTopic("speed_limit", "nav2_msgs/msg/SpeedLimit", RELIABLE, MAP_FRAME)
STOP = RosTopic("stop", "std_msgs/msg/Empty", RELIABLE)
"""The rider's stop; a service of the same name (std_srvs/Trigger) does the same and answers."""

ROBOT_DESCRIPTION = RosTopic("robot_description", "std_msgs/msg/String", LATCHED)
TF = RosTopic("/tf", "tf2_msgs/msg/TFMessage", Qos(100))
TF_STATIC = RosTopic("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
CLOCK = RosTopic("/clock", "rosgraph_msgs/msg/Clock", Qos(1))
DIAGNOSTICS = RosTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

LOCALISATION = RosTopic("localisation", "waychair_msgs/msg/Localisation", RELIABLE, MAP_FRAME)
DRIVE_REQUEST = RosTopic("drive_request", "waychair_msgs/msg/DriveRequest", RELIABLE, BASE_FRAME)
DRIVE_STATE = RosTopic("drive_state", "waychair_msgs/msg/DriveState", RELIABLE, BASE_FRAME)
PLACES = RosTopic("places", "waychair_msgs/msg/Places", LATCHED, MAP_FRAME)

NAVIGATE_TO_POSE = "navigate_to_pose"
"""Name of the action nav2_msgs/action/NavigateToPose."""


def sonar(index: int) -> RosTopic:
    """The topic of one sonar, named after its frame: no part of a topic's name may begin with a digit."""
    frame = SONAR_FRAME.format(index)
    return RosTopic(frame, "sensor_msgs/msg/Range", SENSOR_DATA, frame, topics.SONAR)
