"""The settings of the navigator node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import setting
from waychair.ros.node_settings.shared_fields import (
    calibration_field,
    chair_field,
    map_folder_field,
    scan_frame_field,
    stamped_field,
)
from waychair.runtime.pilot import PilotSettings


@dataclass(frozen=True, slots=True)
class NavigatorNodeSettings(PilotSettings):
    """The chair, and the map whose places and zones apply."""

    calibration: str = calibration_field()
    chair: str = chair_field()
    map_folder: str = map_folder_field()
    camera: bool = setting(True, "", "true: the camera, if there is one, is used to see drop-offs and low obstacles")
    scan_frame: str = scan_frame_field()
    enable_stamped_cmd_vel: bool = stamped_field()
