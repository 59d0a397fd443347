"""The settings of the page node."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.ros.node_settings.shared_fields import calibration_field, chair_field, map_folder_field, scan_frame_field


@dataclass(frozen=True, slots=True)
class PageNodeSettings(Settings):
    """The chair, the map's folder, and the address of the page."""

    calibration: str = calibration_field()
    chair: str = chair_field()
    map_folder: str = map_folder_field()
    scan_frame: str = scan_frame_field()
    host: str = setting(
        "127.0.0.1", "", "address on which the page is served; 0.0.0.0: on all networks of this computer"
    )
    names: str = setting(
        "",
        "",
        "further host names by which other computers open the page, with commas between them; the computer's own "
        "name and its addresses work without this",
    )
    port: int = setting(8000, "", "TCP port on which the page is served", low=1, high=65535)
