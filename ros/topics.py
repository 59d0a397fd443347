"""Topics of the chair's nodes: names, types, frames and QoS as Nav2, RViz and Foxglove users expect them.

`waychair.recordings.bags.ros_topics` defines the topics that bags hold too. Names are relative, so that namespaces and remapping work.
Names with a leading slash are absolute, as in tf2_ros, diagnostic_updater and rclcpp; Nav2's launch files remap them.
"""

from __future__ import annotations

from typing import Any

from waychair import topics
from waychair.recordings.bags.ros_messages import BASE_FRAME, MAP_FRAME, ODOM_FRAME
from waychair.recordings.bags.ros_topics import (
    COLOUR,
    COLOUR_INFO,
    DEPTH,
    DEPTH_INFO,
    IMU,
    JOINTS,
    LATCHED,
    ODOMETRY,
    PRESSURE,
    RELIABLE,
    SCAN,
    SENSOR_DATA,
    TF,
    TF_STATIC,
    TRUTH,
    Qos,
    RosTopic,
    sonar,
)

__all__ = [
    "COLOUR",
    "COLOUR_INFO",
    "DEPTH",
    "DEPTH_INFO",
    "IMU",
    "JOINTS",
    "LATCHED",
    "ODOMETRY",
    "PRESSURE",
    "RELIABLE",
    "SCAN",
    "SENSOR_DATA",
    "TF",
    "TF_STATIC",
    "TRUTH",
    "Qos",
    "RosTopic",
    "sonar",
]

JOY = RosTopic("joy", "sensor_msgs/msg/Joy", SENSOR_DATA, "", topics.JOYSTICK)
BATTERY = RosTopic("battery_state", "sensor_msgs/msg/BatteryState", RELIABLE, "", topics.STATUS)
SEAT = RosTopic("seat_occupied", "std_msgs/msg/Bool", RELIABLE, "", topics.STATUS)
"""Whether the seat is occupied, from the seat switch, where one is fitted (`fitness.seat_switch`)."""

MAP = RosTopic("map", "nav_msgs/msg/OccupancyGrid", LATCHED, MAP_FRAME, topics.MAP)
PLAN = RosTopic("plan", "nav_msgs/msg/Path", RELIABLE, MAP_FRAME, topics.PLAN)
LOCAL_PLAN = RosTopic("local_plan", "nav_msgs/msg/Path", RELIABLE, ODOM_FRAME)
GLOBAL_COSTMAP = RosTopic("global_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED, MAP_FRAME)
LOCAL_COSTMAP = RosTopic("local_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED, ODOM_FRAME)
FOOTPRINT = RosTopic("local_costmap/published_footprint", "geometry_msgs/msg/PolygonStamped", RELIABLE, ODOM_FRAME)
COMMAND = RosTopic("cmd_vel", "geometry_msgs/msg/Twist", RELIABLE, BASE_FRAME, topics.COMMAND)
STAMPED_COMMAND = RosTopic("cmd_vel", "geometry_msgs/msg/TwistStamped", RELIABLE, BASE_FRAME, topics.COMMAND)
"""The command with a stamp, used if `enable_stamped_cmd_vel` is set, as in Nav2."""

GOAL = RosTopic("goal_pose", "geometry_msgs/msg/PoseStamped", RELIABLE, MAP_FRAME, topics.GOAL)
INITIAL_POSE = RosTopic("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", RELIABLE, MAP_FRAME)
POSE = RosTopic("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED, MAP_FRAME)
"""Named after Nav2's localiser, because scripts wait for this topic."""

LINES = RosTopic("ground_truth/lines", "waychair_msgs/msg/Lines", Qos(200, latched=True), BASE_FRAME)
"""The voltages of the simulated joystick lines, at each change: for measurements only, like `TRUTH`."""

SERVO_FRAME = "servo_camera_color_optical_frame"
SERVO_PICTURE = RosTopic("servo_camera/color/image_raw", "sensor_msgs/msg/Image", SENSOR_DATA, SERVO_FRAME)
SERVO_INFO = RosTopic("servo_camera/color/camera_info", "sensor_msgs/msg/CameraInfo", SENSOR_DATA, SERVO_FRAME)
PAN_TILT = RosTopic("servo_camera/angles", "waychair_msgs/msg/PanTiltAngles", RELIABLE, BASE_FRAME)
PAN_TILT_COMMAND = RosTopic("servo_camera/command", "waychair_msgs/msg/PanTiltCommand", RELIABLE, BASE_FRAME)
"""The camera on servos: its pictures, the angles of the same stamps, and the orders to it."""

SPEED_LIMIT = RosTopic("speed_limit", "nav2_msgs/msg/SpeedLimit", RELIABLE, MAP_FRAME)
STOP = RosTopic("stop", "std_msgs/msg/Empty", RELIABLE)
"""The rider's Stop; a service of the same name (std_srvs/Trigger) does the same and answers."""

PAGE_JOYSTICK = RosTopic("page_joystick", "sensor_msgs/msg/Joy", RELIABLE, BASE_FRAME)
"""A page's joystick while it is held; a message without axes means that it was released."""

PAGE_WATCH = RosTopic("page_watch", "std_msgs/msg/Empty", RELIABLE)
"""Heartbeat several times a second while a page with a usable Stop button is open."""

LAYOUT = RosTopic("layout_changed", "std_msgs/msg/Empty", RELIABLE)
"""The places, zones or erased parts in the map's folder have changed."""

PEOPLE = RosTopic("people", "geometry_msgs/msg/PoseArray", RELIABLE, MAP_FRAME)
"""Positions of pedestrians, walking or standing after a walk."""

SIGNAL = RosTopic("perception/signal", "std_msgs/msg/String", RELIABLE)
"""The signal of the behaviour cells to a rider without sight, in words, at each change."""

PERCEPTION = RosTopic("perception/state", "std_msgs/msg/String", RELIABLE)
"""The behaviour cells as a page shows them: a JSON object of `runtime.pages.perception_view.PerceptionView`."""

DOORWAYS = RosTopic("perception/doorways", "geometry_msgs/msg/PoseArray", RELIABLE, ODOM_FRAME)
"""The doorways near the chair that range has borne out: the middle of each, x leads through it."""

ADVICE = RosTopic("haptics/advice", "waychair_msgs/msg/Advice", RELIABLE, BASE_FRAME)
"""Symbols that a driver without sight is to feel and hear; the glove node plays them."""

HAPTIC_STATE = RosTopic("haptics/state", "std_msgs/msg/String", RELIABLE)
"""The rider's glove and voice as a page shows them: a JSON object of `runtime.haptics.haptic_state.HapticState`."""

OTHERS = RosTopic("other_chairs", "std_msgs/msg/String", RELIABLE)
"""The other chairs of the building and the wait for one of them: a JSON object of `runtime.pages.chair_port.OthersView`."""

ROBOT_DESCRIPTION = RosTopic("robot_description", "std_msgs/msg/String", LATCHED)
CLOCK = RosTopic("/clock", "rosgraph_msgs/msg/Clock", Qos(1))
DIAGNOSTICS = RosTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

LOCALISATION = RosTopic("localisation", "waychair_msgs/msg/Localisation", RELIABLE, MAP_FRAME)
DRIVE_REQUEST = RosTopic("drive_request", "waychair_msgs/msg/DriveRequest", RELIABLE, BASE_FRAME)
DRIVE_STATE = RosTopic("drive_state", "waychair_msgs/msg/DriveState", RELIABLE, BASE_FRAME)
GUARD = RosTopic("guard", "waychair_msgs/msg/Guard", RELIABLE, BASE_FRAME)
"""The level of help while the rider drives, and the caps of the board's guard."""

UNSCANNED = RosTopic("guard/unscanned", "std_msgs/msg/String", RELIABLE, MAP_FRAME)
"""Drop-offs and things near the chair that no scan shows, for the guard: a JSON object of `runtime.rider.guard_points.GuardPoints`."""

SEEN_WALLS = RosTopic("guard/seen_walls", "std_msgs/msg/String", RELIABLE, ODOM_FRAME)
"""Walls near a chair whose rider is led without a map, for the guard, as they may be behind it by now: JSON of `GuardPoints`."""

PLACES = RosTopic("places", "waychair_msgs/msg/Places", LATCHED, MAP_FRAME)

FLOOR = RosTopic("floor", "waychair_msgs/msg/Floor", LATCHED, MAP_FRAME)
"""The map in use and its storey, which every node with something of a map follows; the mapper sends it."""

JOURNEY = RosTopic("journey", "waychair_msgs/msg/JourneyState", LATCHED, MAP_FRAME)
STOREY_GOAL = RosTopic("storey_goal", "waychair_msgs/msg/StoreyGoal", RELIABLE)
"""A goal on any storey of the building; the action of `TRAVEL` does the same and answers."""

BEACON = RosTopic("beacon", "std_msgs/msg/String", RELIABLE)
"""The id of a beacon that the chair has met: a tag that a camera read, a radio tag, or a line on the floor."""

GUIDE_TO = RosTopic("guide_to", "waychair_msgs/msg/StoreyGoal", RELIABLE)
GUIDANCE = RosTopic("guidance", "std_msgs/msg/String", LATCHED)
"""A goal to which a rider who drives is told the way, "" to end that; and all that a page shows of it, as a JSON object."""

TRAVEL = "travel"
"""The name of the action waychair_msgs/action/Travel."""

LIFT_REQUESTS = RosTopic("/lift_requests", "rmf_lift_msgs/msg/LiftRequest", Qos(10))
LIFT_STATES = RosTopic("/lift_states", "rmf_lift_msgs/msg/LiftState", Qos(10))
"""Requests to the lifts' adapters, and the lifts' states, named as in Open-RMF."""

BUILDING_GRAPH = RosTopic("building_graph", "visualization_msgs/msg/MarkerArray", LATCHED, MAP_FRAME)
"""The graph of the storey whose map the navigator has, if it is one of a building."""

COMPUTE_ROUTE = "compute_route"
"""The name of the action nav2_msgs/action/ComputeRoute."""

NAVIGATE_TO_POSE = "navigate_to_pose"
"""The name of the action nav2_msgs/action/NavigateToPose."""


def profile(qos: Qos) -> Any:
    """Return rclpy's QoSProfile."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE,
    )
