"""The settings of the cells node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings
from waychair.ros.node_settings.shared_fields import calibration_field, camera_field, chair_field, scan_frame_field
from waychair.runtime.chair import perceive_field


@dataclass(frozen=True, slots=True)
class CellsNodeSettings(Settings):
    """The chair, and its sensors besides lidar and sonars."""

    calibration: str = calibration_field()
    chair: str = chair_field()
    camera: bool = camera_field()
    scan_frame: str = scan_frame_field()
    perceive: bool = perceive_field()
