"""The settings of the glove node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.ros.node_settings.shared_fields import calibration_field, chair_field, scan_frame_field


@dataclass(frozen=True, slots=True)
class GloveNodeSettings(Settings):
    """The chair, the glove and its rider."""

    calibration: str = calibration_field()
    chair: str = chair_field()
    scan_frame: str = scan_frame_field()
    port: str = setting("", "", "port of the glove: /dev/ttyUSB1, pty:/dev/pts/N or tcp:HOST:PORT; empty: no glove")
    profile: str = setting(
        "", "", "file of the rider who is told (`waychair haptics tune`); empty: a right hand, untuned"
    )
