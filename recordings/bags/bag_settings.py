"""Settings of reading a bag: its topics and frames. They are known without reading one."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting

NOT_USED = "none"
"""Name in place of a topic for odometry or an IMU that is not to be used."""


@dataclass(frozen=True, slots=True)
class BagSettings(Settings):
    """The topics and frames to read from a bag; an empty name means the usual one, else the best guess."""

    scan_topics: tuple[str, ...] = setting(
        (), "", "topics of the scans or point clouds to map; several are merged into one scan; empty: guessed"
    )
    odom_topic: str = setting(
        "", "", "topic of the odometry; empty: guessed, or /tf if no topic has any; none: not used"
    )
    imu_topic: str = setting("", "", "topic of the IMU; empty: guessed; none: not used")
    colour_topic: str = setting("", "", "topic of the colour or grey pictures; empty: guessed")
    depth_topic: str = setting("", "", "topic of the depth pictures that are registered to colour; empty: guessed")
    base_frame: str = setting("", "", "frame of the chair in the bag, the parent of the sensor mounts; empty: guessed")
    cloud_low: float = setting(
        0.3, "m", "lowest height of point-cloud points that count as obstacles; larger: less floor, fewer low objects",
        low=-10, high=10,
    )  # fmt: skip
    cloud_high: float = setting(
        1.2, "m", "largest height of point-cloud points that count as obstacles; larger: more overhanging objects",
        low=-10, high=10,
    )  # fmt: skip
