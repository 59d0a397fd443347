"""The settings of the mapper node."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.ros.node_settings.shared_fields import (
    calibration_field,
    chair_field,
    imu_frame_field,
    map_folder_field,
    scan_frame_field,
)
from waychair.slam.localising.localiser import LocaliserSettings
from waychair.slam.mapping.live_mapping import LiveMappingSettings


@dataclass(frozen=True, slots=True)
class MapperNodeSettings(Settings):
    """The map to localise on, or how to make one."""

    map_folder: str = map_folder_field()
    calibration: str = calibration_field()
    chair: str = chair_field()
    pose_file: str = setting(
        "", "", "file in which the chair's pose is kept from one run to the next; empty: localise globally at the start"
    )
    save_folder: str = setting(
        "", "", "folder to which a map that is being made is saved when the node ends; empty: only on request"
    )
    scan_frame: str = scan_frame_field()
    imu_frame: str = imu_frame_field()
    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    live: LiveMappingSettings = field(default_factory=LiveMappingSettings)
