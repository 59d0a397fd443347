"""The settings of the navigator node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.ros.node_settings.shared_fields import (
    calibration_field,
    camera_field,
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
    camera: bool = camera_field()
    scan_frame: str = scan_frame_field()
    enable_stamped_cmd_vel: bool = stamped_field()
