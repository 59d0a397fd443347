"""The chair's body, drive and sensor mounts as data, shared by simulation, footprint and calibration.

Lengths are in metres in the base frame (origin on the floor under the middle of the drive axle). A is the default, B a
larger chair. A_mid and A_front are A with mid or front drive wheels and its sensors at the same places of the seat.
robot is the small disc of benchmarks among moving people, as its bounding square.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import rectangle
from waychair.types import FloatArray, Pose2, Pose3

DRIVES = ("rear", "mid", "front")
"""Places of the drive wheels: behind the casters, between them, or in front of them."""

SONAR_LAYOUTS = ("ring", "paper")
"""Places of the sonars: two on each side of the chair, or six across its front and two behind (`sonar_mounts`)."""


class BodyLayer(NamedTuple):
    """The chair's outline between two heights above the floor, such as at feet, knees or arm rests; all in metres.

    It reaches `front` ahead of the drive axle, `rear` behind it, and `half_width` to both sides.
    """

    bottom: float
    top: float
    front: float
    rear: float
    half_width: float


TALLEST = 1.4
"""m; height of a chair with its rider, up to which obstacles count."""


@dataclass(frozen=True, slots=True)
class ChairBody(Settings):
    """A chair's footprint, wheels and sensor mounts."""

    chair_id: str = setting("A", "", "name of the measured chair")
    length: float = setting(
        1.00, "m", "overall length of the chair; larger: it needs more room to turn", low=0.3, high=2.5
    )
    width: float = setting(0.60, "m", "overall width of the chair; larger: fewer doors are passable", low=0.2, high=1.5)
    axle_from_rear: float = setting(
        0.25,
        "m",
        "distance of the drive axle ahead of the chair's rear end; larger: its rear swings out farther in turns",
        low=0.0,
        high=2.0,
    )
    track: float = setting(
        0.54,
        "m",
        "distance between the drive wheels' contacts; larger: the same difference of the wheels turns it less",
        low=0.1,
        high=1.5,
    )
    wheel_radius: float = setting(
        0.165, "m", "radius of the drive wheels; larger: each encoder count is a longer distance", low=0.02, high=0.6
    )
    ticks_per_turn: int = setting(
        4096,
        "counts",
        "encoder counts per turn of a drive wheel; more: each count is a shorter distance",
        low=16,
        high=1_000_000,
    )
    laser_x: float = setting(
        0.60, "m", "distance of the lidar ahead of the drive axle; negative: behind it", low=-2.0, high=2.0
    )
    laser_y: float = setting(
        0.0, "m", "distance of the lidar to the left of the chair's middle; negative: to the right", low=-1.0, high=1.0
    )
    laser_theta: float = setting(
        0.0,
        "rad",
        "direction of the lidar's x axis in the chair; larger: turned farther to the left",
        low=-math.pi,
        high=math.pi,
    )
    drive: str = setting("rear", "", "place of the drive wheels: rear, mid or front")
    laser_z: float = setting(
        0.30, "m", "height of the lidar above the floor; larger: it passes over more low obstacles", low=0.02, high=2.0
    )
    camera_x: float = setting(
        0.40, "m", "distance of the camera ahead of the drive axle; negative: behind it", low=-2.0, high=2.0
    )
    camera_y: float = setting(
        0.20,
        "m",
        "distance of the camera to the left of the chair's middle; negative: to the right",
        low=-1.0,
        high=1.0,
    )
    camera_z: float = setting(
        0.95,
        "m",
        "height of the camera above the floor; larger: it looks down on more of the floor",
        low=0.05,
        high=2.5,
    )
    camera_yaw: float = setting(
        0.0, "rad", "turn of the camera to the left; negative: to the right", low=-math.pi, high=math.pi
    )
    camera_pitch: float = setting(
        0.05, "rad", "tilt of the camera; larger: it looks farther down; negative: up", low=-1.5, high=1.5
    )
    imu_x: float = setting(
        0.10,
        "m",
        "distance of the IMU, with the base's axes, ahead of the drive axle; negative: behind it",
        low=-2.0,
        high=2.0,
    )
    imu_y: float = setting(
        0.0, "m", "distance of the IMU to the left of the chair's middle; negative: to the right", low=-1.0, high=1.0
    )
    imu_z: float = setting(
        0.35, "m", "height of the IMU above the floor; larger: it moves more when the chair tilts", low=0.0, high=2.0
    )
    layers: tuple[BodyLayer, ...] = setting(
        (),
        "m",
        "outlines of the chair, upwards: [bottom, top, front, rear, half_width]; empty: one outline for all heights",
    )
    sonar_layout: str = setting(
        "ring", "", "places of the eight sonars: ring (two on each side) or paper (six across the front, two behind)"
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.drive not in DRIVES:
            raise ConfigError(f"drive = '{self.drive}' is unknown: take {', '.join(DRIVES[:-1])} or {DRIVES[-1]}")
        if self.sonar_layout not in SONAR_LAYOUTS:
            raise ConfigError(f"sonar_layout = '{self.sonar_layout}' is unknown: take {' or '.join(SONAR_LAYOUTS)}")
        if self.width > self.length:
            raise ConfigError(
                f"width = {self.width:g} m exceeds length = {self.length:g} m: give them the other way round"
            )
        bottom = 0.0
        for layer in self.layers:
            sides = (layer.front, self.front), (layer.rear, self.rear), (layer.half_width, self.width / 2)
            if not all(0.0 < inner <= outer + 1e-9 for inner, outer in sides):
                raise ConfigError(f"{layer} does not lie within the outline; make the outline hold all its layers")
            if not (layer.bottom == bottom and layer.top > bottom):
                raise ConfigError(f"{layer} leaves a gap above {bottom} m; give the layers upwards from the floor")
            bottom = layer.top

    @property
    def front(self) -> float:
        """Reach ahead of the drive axle [m]."""
        return self.length - self.axle_from_rear

    @property
    def rear(self) -> float:
        """Reach behind the drive axle [m]."""
        return self.axle_from_rear

    @property
    def base_from_laser(self) -> Pose2:
        """Mount of the lidar."""
        return Pose2(self.laser_x, self.laser_y, self.laser_theta)

    @property
    def base_from_camera(self) -> Pose3:
        """Mount of the camera's optical frame (REP-103: z forward, x right, y down); base at floor height."""
        optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        (sy, cy), (sp, cp) = ((math.sin(a), math.cos(a)) for a in (self.camera_yaw, self.camera_pitch))
        yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        return Pose3(yaw @ pitch @ optical, np.array([self.camera_x, self.camera_y, self.camera_z]))

    @property
    def circumscribed_radius(self) -> float:
        """Distance of the farthest corner from the base origin [m]: the radius swept by turning on the spot."""
        return math.hypot(max(self.front, self.rear), self.width / 2)

    def height_layers(self) -> tuple[BodyLayer, ...]:
        """Return the outlines by height, upwards from the floor without a gap; a single one by default."""
        return self.layers or (BodyLayer(0.0, TALLEST, self.front, self.rear, self.width / 2),)

    def outline(self) -> FloatArray:
        """Return the footprint's corners (4, 2) [m] in the base frame, counter-clockwise."""
        return rectangle(self.front, self.rear, self.width / 2)


def sonar_mounts(body: ChairBody) -> tuple[Pose2, ...]:
    """Return `base_from_sonar` of the eight sonars of the body's layout, on the outline.

    "ring": facing straight out, counter-clockwise from the front left one: one ahead, two on the left, two behind, two
    on the right, one ahead. "paper": `paper_sonar_mounts`.
    """
    if body.sonar_layout == "paper":
        return paper_sonar_mounts(body)
    front, rear, side, quarter = body.front, -body.rear, body.width / 2, body.width / 4
    fore, aft = front - body.length / 4, rear + body.length / 4
    left, back, right = math.pi / 2, math.pi, -math.pi / 2
    return (
        Pose2(front, quarter, 0.0),
        Pose2(fore, side, left),
        Pose2(aft, side, left),
        Pose2(rear, quarter, back),
        Pose2(rear, -quarter, back),
        Pose2(aft, -side, right),
        Pose2(fore, -side, right),
        Pose2(front, -quarter, 0.0),
    )


def paper_sonar_mounts(body: ChairBody) -> tuple[Pose2, ...]:
    """Return `base_from_sonar` of the eight sonars of the paper's chair: six to the front side, two to the rear.

    Counter-clockwise from the rear right one: right of straight back; right, front right, two ahead, front left, left;
    left of straight back. The paper gives the counts only; the angles are ours: 10, 40 and 75 degrees from straight
    ahead, and 15 from straight back.
    """
    front, rear, side, quarter = body.front, -body.rear, body.width / 2, body.width / 4
    to_right = (
        Pose2(rear, -quarter, -math.radians(165.0)),
        Pose2(front - body.length / 10, -side, -math.radians(75.0)),
        Pose2(front, -side, -math.radians(40.0)),
        Pose2(front, -quarter, -math.radians(10.0)),
    )
    return (*to_right, *(Pose2(at.x, -at.y, -at.theta) for at in reversed(to_right)))


CHAIR_A = ChairBody()
CHAIR_B = ChairBody(chair_id="B", length=1.10, width=0.70, track=0.62)
CHAIR_A_MID = ChairBody(chair_id="A_mid", drive="mid", axle_from_rear=0.50, laser_x=0.35, camera_x=0.15, imu_x=-0.15)
CHAIR_A_FRONT = ChairBody(
    chair_id="A_front", drive="front", axle_from_rear=0.75, laser_x=0.10, camera_x=-0.10, imu_x=-0.40
)
ROBOT = ChairBody(
    chair_id="robot",
    drive="mid",
    length=0.30,
    width=0.30,
    axle_from_rear=0.15,
    track=0.24,
    wheel_radius=0.05,
    laser_x=0.0,
    laser_z=0.20,
    camera_x=0.10,
    camera_y=0.0,
    camera_z=0.22,
    imu_x=0.0,
    imu_z=0.10,
)

BODIES: Mapping[str, ChairBody] = MappingProxyType(
    {body.chair_id: body for body in (CHAIR_A, CHAIR_B, CHAIR_A_MID, CHAIR_A_FRONT, ROBOT)}
)
"""The built-in bodies by name."""
