"""The settings of the bridge node."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import setting
from waychair.errors import ConfigError
from waychair.ros.node_settings.shared_fields import (
    calibration_field,
    chair_field,
    imu_frame_field,
    map_folder_field,
    scan_frame_field,
    stamped_field,
)
from waychair.runtime.base_settings import BaseSettings
from waychair.runtime.black_box.recorder import BlackBoxSettings
from waychair.types import HelpLevel


@dataclass(frozen=True, slots=True)
class BridgeNodeSettings(BaseSettings):
    """The chair, the cable, the map whose zones apply, the black box, and the acceptance of commands and goals."""

    calibration: str = calibration_field()
    chair: str = chair_field()
    cable: str = setting("pty:/tmp/waychair-board", "", "port of the board: /dev/..., pty:PATH or tcp:HOST:PORT")
    map_folder: str = map_folder_field()
    scan_frame: str = scan_frame_field()
    imu_frame: str = imu_frame_field()
    enable_stamped_cmd_vel: bool = stamped_field()
    black_box_folder: str = setting("", "", "folder of the black box; empty: no black box is kept")
    black_box: BlackBoxSettings = field(default_factory=BlackBoxSettings)
    help_level: str = setting(
        "inform",
        "",
        "level of help: inform, guard or guide; set while the node runs it begins, at the start it is offered",
    )
    ignore_commands: bool = setting(
        False, "", "true: all speeds and joysticks of other nodes are ignored, as on an open network"
    )
    confirm_goals: bool = setting(
        False, "", "true: each goal is confirmed at once and nobody is asked, only for a simulated chair"
    )

    def __post_init__(self) -> None:
        BaseSettings.__post_init__(self)
        known = [level.value for level in HelpLevel]
        if self.help_level not in known:
            raise ConfigError(f"help_level = '{self.help_level}' is impossible: choose among {', '.join(known)}")
