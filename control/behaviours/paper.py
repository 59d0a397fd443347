"""The paper's network, wired as in its figures 6, 7, 8, 11 and 12. This preset is a baseline and stays as it is.

Sensors: the sonars' packet, the frames found in the picture, the laser line in it, the servos' angles, the rider's
stick, the rider's wish for a door, and odometry. Effectors: the pan/tilt servos, the laser, and the vibrotactors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.calibration.chair_body import CHAIR_A, ChairBody, paper_sonar_mounts
from waychair.config import Settings
from waychair.control.behaviours.cell import Cell, Sensor, before
from waychair.control.behaviours.cell_network import Network, Wiring, wire
from waychair.control.behaviours.conditions import Active, AtLeast
from waychair.control.behaviours.doorway import (
    FramesSeen,
    OdometryPose,
    PathMemory,
    TrackerMemory,
    detect_doorway,
    plan_path,
    track_door,
    validate_door,
)
from waychair.control.behaviours.free_space import (
    NOT_LOOKED,
    WayFinderConstants,
    WayFinderMemory,
    find_way,
)
from waychair.control.behaviours.glove import GloveLayout, encode_signal
from waychair.control.behaviours.managers import (
    GrantMemory,
    StickDirection,
    aim_servos,
    choose_signal,
    gate_signals,
    grant,
    inhibit,
    light_laser,
    merge_commands,
    select_signal,
)
from waychair.control.behaviours.paper_settings import CameraLimits, DoorLimits, NavigationLimits, ObstacleLimits
from waychair.control.behaviours.range_finder import CameraAim, CameraMemory, LaserLine, find_range
from waychair.control.behaviours.sonar import LastClasses, SonarPacket, decode_packet, read_sonars, translate_data
from waychair.errors import ConfigError


@dataclass(frozen=True, slots=True)
class PaperSettings(Settings):
    """All thresholds of the paper's network."""

    obstacles: ObstacleLimits = field(default_factory=ObstacleLimits)
    camera: CameraLimits = field(default_factory=CameraLimits)
    doors: DoorLimits = field(default_factory=DoorLimits)
    navigation: NavigationLimits = field(default_factory=NavigationLimits)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.camera.aimed >= self.doors.jamb:
            raise ConfigError(
                f"camera aimed = {self.camera.aimed:g} rad is not below doors jamb = {self.doors.jamb:g} rad: a jamb would "
                "be looked for beside its place; give the smaller error"
            )


SENSORS = (
    Sensor("sonar packet", SonarPacket),
    Sensor("frames in the picture", FramesSeen),
    Sensor("laser line in the picture", LaserLine),
    Sensor("camera aim", CameraAim),
    Sensor("stick", StickDirection),
    Sensor("door wanted", bool),
    Sensor("odometry", OdometryPose),
)


def paper_network(settings: PaperSettings | None = None, body: ChairBody = CHAIR_A) -> Wiring:
    """Return the paper's network for a chair."""
    s = settings or PaperSettings()
    sonars = tuple(mount.theta for mount in paper_sonar_mounts(body))

    def fresh(seconds: float, *ports: str) -> dict[str, int]:
        return dict.fromkeys(ports, round(seconds * 1e9))

    # Figure 7: Obstacle notification
    sonar_reader = Cell(
        "Sonar reader",
        read_sonars,
        links={"packet": "sonar packet"},
        fresh_ns=fresh(s.obstacles.stale, "packet"),
    )
    obstacle_notification = Network(
        "Obstacle notification",
        [
            sonar_reader,
            Cell("decode_packet", decode_packet, links={"packet": "Sonar reader"}),
            Cell(
                "translate_data",
                translate_data,
                links={"ranges": "decode_packet"},
                constants=s.obstacles,
                dynamic=LastClasses(),
            ),
        ],
        output="translate_data",
    )

    # Figure 11: Doorway navigation
    range_finder = Cell(
        "Range finder",
        find_range,
        links={"line": "laser line in the picture", "aim": "camera aim"},
        fresh_ns=fresh(s.camera.fresh, "line", "aim"),
        excited_by=Active("Door validation", before=True)
        | Active("Object tracker", before=True)
        | AtLeast("Way finder", 1, of="asks", before=True),
        constants=s.camera,
        dynamic=CameraMemory(),
    )
    doorway_navigation = Network(
        "Doorway navigation",
        [
            range_finder,
            Cell(
                "Doorway detection",
                detect_doorway,
                links={"frames": "frames in the picture"},
                fresh_ns=fresh(s.camera.fresh, "frames"),
                constants=s.doors,
            ),
            Cell(
                "Door validation",
                validate_door,
                links={"candidate": "Doorway detection", "depth": "Range finder"},
                fresh_ns=fresh(s.camera.fresh, "depth"),
                excited_by=AtLeast("Doorway detection", s.doors.confidence, of="confidence"),
                constants=s.doors,
            ),
            Cell(
                "Object tracker",
                track_door,
                links={"check": "Door validation", "odometry": "odometry"},
                fresh_ns=fresh(s.camera.fresh, "check", "odometry"),
                excited_by=AtLeast("Door validation", 1, of="valid")
                | (Active("Object tracker", before=True) & AtLeast("Object tracker", 1, of="held", before=True)),
                constants=(s.doors, s.camera),
                dynamic=TrackerMemory(),
            ),
            Cell(
                "Path planner",
                plan_path,
                links={"tracked": "Object tracker"},
                excited_by=Active("Object tracker"),
                constants=(s.doors, body),
                dynamic=PathMemory(),
            ),
        ],
        output="Path planner",
        excited_by=AtLeast("door wanted", 1),
    )

    # Section 3.4: Sensor command manager. It runs before Free-space finding, whose request it reads as it was before.
    sensor_command_manager = Network(
        "Sensor command manager",
        [
            Cell(
                "inhibit Free-space finding",
                inhibit,
                excited_by=Active("Object tracker") | Active("Door validation"),
            ),
            Cell(
                "grant",
                grant,
                {"pan/tilt servos": aim_servos, "laser": light_laser},
                links={
                    "tracker": "Object tracker",
                    "door_range": "Door validation",
                    "way_finder": before("Way finder"),
                    "aim": "camera aim",
                },
                fresh_ns=fresh(s.camera.fresh, "aim"),
                constants=s.camera,
                dynamic=GrantMemory(),
            ),
        ],
        output="grant",
    )

    # Figure 8: Free-space finding. Sonar reader and Range finder belong to it as well; decode_packet is its own.
    free_space_finding = Network(
        "Free-space finding",
        [
            sonar_reader,
            range_finder,
            Cell("decode_packet (free space)", decode_packet, links={"packet": "Sonar reader"}),
            Cell(
                "Way finder",
                find_way,
                links={"ranges": "decode_packet (free space)", "depth": "Range finder", "granted": "grant"},
                fresh_ns=fresh(s.camera.fresh, "depth", "granted"),
                constants=WayFinderConstants(sonars, body, s.obstacles, s.camera, s.navigation),
                dynamic=WayFinderMemory(),
                inhibited_output=NOT_LOOKED,
            ),
        ],
        output="Way finder",
        inhibited_by=Active("inhibit Free-space finding"),
    )

    # Figure 12: Navigation command manager
    navigation_command_manager = Network(
        "Navigation command manager",
        [
            Cell("gate_signals", gate_signals, links={"way": "Free-space finding"}),
            Cell(
                "select_signal",
                select_signal,
                links={"gated": "gate_signals", "obstacles": "Obstacle notification", "stick": "stick"},
                fresh_ns=fresh(s.obstacles.stale, "stick"),
                constants=s.navigation,
            ),
            Cell(
                "merge_commands",
                merge_commands,
                links={"gated": "gate_signals", "door": "Doorway navigation"},
                excited_by=Active("Doorway navigation") & Active("Path planner"),
                constants=s.navigation,
            ),
            Cell(
                "encode_packet",
                choose_signal,
                {"vibrotactors": encode_signal},
                links={
                    "obstacles": "Obstacle notification",
                    "selected": "select_signal",
                    "merged": "merge_commands",
                },
                constants=s.navigation,
                static=GloveLayout(sonars),
            ),
        ],
        output="encode_packet",
    )

    # Figure 6
    return wire(
        Network(
            "Perceptual navigation",
            [
                obstacle_notification,
                doorway_navigation,
                sensor_command_manager,
                free_space_finding,
                navigation_command_manager,
            ],
            output="Navigation command manager",
        ),
        SENSORS,
    )
