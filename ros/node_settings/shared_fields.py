"""Settings that several nodes share, with one meaning and one text: each function makes a dataclass field."""

from __future__ import annotations

from waychair.config import setting
from waychair.recordings.bags.ros_messages import IMU_FRAME, LASER_FRAME


def calibration_field() -> str:
    """Make the field for the file of a real chair."""
    return setting("", "", "calibration file of the chair (`waychair calibrate`); empty: the simulated chair's values")


def chair_field() -> str:
    """Make the field for the simulated chair."""
    return setting("A", "", "simulated chair by name, or its .yaml file; a calibration file takes its place")


def map_folder_field() -> str:
    """Make the field for the folder of the map that the nodes share."""
    return setting("", "", "folder of the map, with its places and zones; empty: no map is given, the mapper makes one")


def scan_frame_field() -> str:
    """Make the field for the lidar's frame."""
    return setting(LASER_FRAME, "", "frame of the lidar in the chair's file; scans in another frame are refused")


def imu_frame_field() -> str:
    """Make the field for the IMU's frame."""
    return setting(IMU_FRAME, "", "frame of the IMU in the chair's file; samples in another frame are refused")


def stamped_field() -> bool:
    """Make the field for the type of cmd_vel, named as in Nav2."""
    return setting(False, "", "true: cmd_vel is a TwistStamped, as in Nav2 from Kilted on; false: it is a Twist")


def camera_field() -> bool:
    """Make the field for the use of the depth camera."""
    return setting(True, "", "true: the camera, if there is one, is used to see drop-offs and low obstacles")
