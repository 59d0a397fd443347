"""The same cells with today's sensors: lidar, depth, borne-out echoes, ground and drop-offs, the laser's line, people,
map and pose.

Each sensor's cell gives `Fans`, and the view is gathered from all of them: the Way finder is not told where it comes
from. Free space has 16 sectors by the outline that this chair sweeps. Doorways come found and measured
(`planning/seen`), so that detection chooses one and validation checks its state and width. The Sensor watch names the
sensors that are not to be believed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.control.behaviours.cell import Cell, Reading, Sensor, before
from waychair.control.behaviours.cell_network import Network, Wiring, wire
from waychair.control.behaviours.commands import (
    NULL,
    STOP,
    FreeCommand,
    FreeKind,
    Signal,
    SignalKind,
    sector_middles,
)
from waychair.control.behaviours.conditions import Active, AtLeast
from waychair.control.behaviours.doorway import (
    FramesSeen,
    OdometryPose,
    PathMemory,
    TrackerMemory,
    detect_doorway,
    plan_path,
    track_door,
)
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.glove import GloveLayout, encode_signal
from waychair.control.behaviours.managers import (
    NOT_HEARD,
    StickDirection,
    aim_servos,
    choose_signal,
    gate_signals,
    light_laser,
    merge_commands,
    select_signal,
)
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.paper_settings import NavigationLimits, ObstacleLimits
from waychair.control.behaviours.range_finder import (
    CameraAim,
    CameraMemory,
    Depth,
    LaserLine,
    SensorCommand,
    find_range,
)
from waychair.control.behaviours.sonar import LastClasses, Obstacle, ObstacleClasses, obstacle_class
from waychair.control.behaviours.view.door_cells import ChosenDoor, DoorsSeen, check_door, choose_door
from waychair.control.behaviours.view.local_view import Fans, LocalView, MapPart, ViewMemory, gather_views
from waychair.control.behaviours.view.sensor_cells import (
    EchoMemory,
    SensorTroubles,
    WatchMemory,
    check_echoes,
    echo_fans,
    lidar_fans,
    pass_fans,
    watch_sensors,
)
from waychair.control.behaviours.view.servo_cells import (
    ShareMemory,
    SweepMemory,
    line_fans,
    servo_camera_limits,
    share_camera,
    swept_look,
)
from waychair.control.behaviours.view.swept_sectors import free_orientations, sweep_reach
from waychair.errors import ConfigError
from waychair.types import BoolArray, FloatArray, Scan, SonarReadings

SECTORS = 16
"""Sectors of free space, 22.5 degrees each."""

VIEW_NS = 100_000_000
"""Period of the view, that of the lidar; ways and classes follow it."""

WATCH_NS = 200_000_000
"""Period of the Sensor watch: nobody reads its sentences faster."""

FRAME_NS = 2_000_000_000
"""Age above which a door frame in a picture is not looked at any more: its direction is that of the picture."""

MAP_NS = 2_000_000_000
"""Age above which a part of the map is not used: it is told once a second."""


def view_classes(
    view: LocalView, constants: tuple[ObstacleLimits, ChairBody], dynamic: LastClasses
) -> tuple[ObstacleClasses, LastClasses]:
    """Return the class of the nearest obstacle in each of eight directions, measured from the outline.

    A direction of which less than half of the ground up to an immediate obstacle was seen, and that shows nothing, is
    unknown.
    """
    limits, body = constants
    middles = sector_middles()
    outline = body.front, body.rear, body.width / 2
    reach = min(outline) + limits.immediate
    nearest, seen = _nearest(view.metres(), view.unseen_places(reach), *outline, len(middles))
    before = dynamic.classes or (Obstacle.UNKNOWN,) * len(middles)
    classes = tuple(
        obstacle_class(float(nearest[k]) if math.isfinite(nearest[k]) or seen[k] else math.nan, before[k], limits)
        for k in range(len(middles))
    )
    return ObstacleClasses(classes), LastClasses(classes)


@njit(cache=True, nogil=True)
def _nearest(
    points: FloatArray, unseen: FloatArray, front: float, rear: float, half: float, count: int
) -> tuple[FloatArray, BoolArray]:
    """Return for each direction (count,) the distance [m] of the nearest point from the outline, and whether it was seen.

    `unseen` (M, 2) [m] are the near places that no sensor saw; a direction was seen if it has few of them.
    """
    nearest, hidden = np.full(count, np.inf), np.zeros(count, np.int64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        outside = math.hypot(max(x - front, -rear - x, 0.0), max(abs(y) - half, 0.0))
        if outside > 0.0:
            sector = round(math.atan2(y, x) / math.tau * count) % count
            nearest[sector] = min(nearest[sector], outside)
    for i in range(len(unseen)):
        hidden[round(math.atan2(unseen[i, 1], unseen[i, 0]) / math.tau * count) % count] += 1
    return nearest, hidden < _HIDDEN


_HIDDEN = 20
"""Unseen cells of a direction from which on it counts as unseen: about half of those up to an immediate obstacle."""


def find_swept_way(
    view: LocalView | None,
    depth: Reading[Depth] | None,
    aim: CameraAim | None,
    granted: SensorCommand | None,
    constants: ChairBody,
    dynamic: SweepMemory,
    now_ns: int,
) -> tuple[WayFound, SweepMemory]:
    """Return the orientations in which this chair can turn and drive off; without a view it did not look.

    A chair with a camera on servos (`aim`) looks into several ways in turn.
    """
    seen_ns = None if depth is None else depth.stamp_ns
    request, memory = (None, dynamic) if aim is None else swept_look(seen_ns, granted, dynamic, now_ns)
    if view is None:
        return WayFound(NULL, request), memory
    free = free_orientations(
        view.metres(), view.margins(), view.unseen_places(sweep_reach(constants)), constants, SECTORS
    )
    middles = sector_middles(SECTORS)
    listed = tuple(middles[k] for k in range(SECTORS) if free[k])
    return WayFound(FreeCommand(FreeKind.LIST, listed, SECTORS) if listed else STOP, request), memory


def tell_signal(
    obstacles: ObstacleClasses | None,
    selected: Signal | None,
    merged: Reading[Signal] | None,
    troubles: SensorTroubles | None,
    constants: NavigationLimits,
    now_ns: int,
) -> Signal:
    """Return the paper's choice of one signal; where nothing is known, its warning names the cause."""
    signal = choose_signal(obstacles, selected, merged, constants, now_ns)
    if signal.kind is SignalKind.WARNING and signal.reason == NOT_HEARD:
        sentences = troubles.sentences if troubles is not None else ()
        return Signal(SignalKind.WARNING, sentences[0] if sentences else "nothing is seen yet")
    return signal


SENSORS = (
    Sensor("lidar", Scan),
    Sensor("depth", Fans),
    Sensor("drop-offs", Fans),
    Sensor("sonars", SonarReadings),
    Sensor("people", Fans),
    Sensor("map round the chair", MapPart),
    Sensor("frames in the picture", FramesSeen),
    Sensor("laser line in the picture", LaserLine),
    Sensor("camera aim", CameraAim),
    Sensor("camera fault", str),
    Sensor("odometry", OdometryPose),
    Sensor("doorways", DoorsSeen),
    Sensor("door wanted", bool),
    Sensor("stick", StickDirection),
)


def default_network(settings: PaperSettings | None = None, body: ChairBody = CHAIR_A) -> Wiring:
    """Return the network with today's sensors for a chair.

    Raises:
        ConfigError: values would be too old before they are read.
    """
    s = settings or PaperSettings()
    stale = round(s.obstacles.stale * 1e9)
    if stale < 2 * VIEW_NS:
        raise ConfigError(
            f"stale = {s.obstacles.stale:g} s is shorter than two periods of the view ({VIEW_NS * 1e-9:g} s each), so "
            "nothing would ever be free: make it longer"
        )
    camera, camera_ns = servo_camera_limits(s.camera), round(s.camera.fresh * 1e9)
    view = Network(
        "View",
        [
            Cell(
                "Lidar view",
                lidar_fans,
                links={"scan": "lidar", "odometry": "odometry"},
                fresh_ns={"odometry": stale},
                triggers=("lidar",),
                constants=body,
            ),
            Cell("Depth view", pass_fans, links={"part": "depth"}, triggers=("depth",)),
            Cell("Ground view", pass_fans, links={"part": "drop-offs"}, triggers=("drop-offs",)),
            Cell("Echo view", echo_fans, links={"checked": "Sonar check"}, triggers=("Sonar check",), constants=body),
            Cell(
                "Range finder",
                find_range,
                links={"line": "laser line in the picture", "aim": "camera aim"},
                fresh_ns={"line": camera_ns, "aim": camera_ns},
                triggers=("laser line in the picture",),
                constants=camera,
                dynamic=CameraMemory(),
            ),
            Cell("Line view", line_fans, links={"depth": "Range finder"}, triggers=("Range finder",), constants=camera),
            Cell("People view", pass_fans, links={"part": "people"}, triggers=("people",)),
            Cell(
                "Gathered view",
                gather_views,
                links={
                    "odometry": "odometry",
                    "lidar": "Lidar view",
                    "depth": "Depth view",
                    "drop_offs": "Ground view",
                    "echoes": "Echo view",
                    "people": "People view",
                    "line": "Line view",
                    "surroundings": "map round the chair",
                },
                fresh_ns={"odometry": stale, "surroundings": MAP_NS},
                constants=body,
                dynamic=ViewMemory(),
            ),
        ],
        output="Gathered view",
        every_ns=VIEW_NS,
    )
    sensor_check = Network(
        "Sensor check",
        [
            Cell(
                "Sonar check",
                check_echoes,
                links={"readings": "sonars", "odometry": "odometry"},
                triggers=("sonars",),
                dynamic=EchoMemory(),
            ),
            Cell(
                "Sensor watch",
                watch_sensors,
                links={"lidar": "lidar", "echoes": "Sonar check", "depth": "depth", "odometry": "odometry"}
                | {"aim": "camera aim", "camera_fault": "camera fault"},
                dynamic=WatchMemory(),
                every_ns=WATCH_NS,
            ),
        ],
        output="Sensor watch",
    )
    obstacle_notification = Network(
        "Obstacle notification",
        [
            view,
            Cell(
                "translate_data",
                view_classes,
                links={"view": "View"},
                constants=(s.obstacles, body),
                dynamic=LastClasses(),
                triggers=("View",),
            ),
        ],
        output="translate_data",
    )
    doorway_navigation = Network(
        "Doorway navigation",
        [
            Cell(
                "Doorway detection",
                choose_door,
                links={"seen": "doorways"},
                triggers=("doorways",),
                constants=body,
                dynamic=ChosenDoor(),
            ),
            Cell(
                "Frame detection",
                detect_doorway,
                links={"frames": "frames in the picture"},
                triggers=("frames in the picture",),
                constants=s.doors,
            ),
            Cell(
                "Door validation",
                check_door,
                links={"seen": "Doorway detection", "frame": "Frame detection"},
                fresh_ns={"seen": camera_ns, "frame": FRAME_NS},
                triggers=("Doorway detection", "Frame detection"),
                constants=(s.doors, body),
            ),
            Cell(
                "Object tracker",
                track_door,
                links={"check": "Door validation", "odometry": "odometry"},
                fresh_ns={"check": 0, "odometry": stale},  # a check lies in base as it was when it was made
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
        reset_by=AtLeast("Sensor check", 1, of="leapt"),  # a door held in odom is no longer where it was
    )
    free_space_finding = Network(
        "Free-space finding",
        [
            view,
            Cell(
                "Way finder",
                find_swept_way,
                links={"view": "View", "depth": "Range finder", "aim": "camera aim", "granted": before("grant")},
                constants=body,
                dynamic=SweepMemory(),
                triggers=("View",),
            ),
        ],
        output="Way finder",
    )
    sensor_command_manager = Network(
        "Sensor command manager",
        [
            Cell(
                "grant",
                share_camera,
                {"pan/tilt servos": aim_servos, "laser": light_laser},
                links={
                    "tracker": "Object tracker",
                    "door_range": "Door validation",
                    "way_finder": "Way finder",
                    "aim": "camera aim",
                },
                triggers=("camera aim",),
                constants=camera,
                dynamic=ShareMemory(),
            )
        ],
        output="grant",
    )
    navigation_command_manager = Network(
        "Navigation command manager",
        [
            Cell("gate_signals", gate_signals, links={"way": "Free-space finding"}),
            Cell(
                "select_signal",
                select_signal,
                links={"gated": "gate_signals", "obstacles": "Obstacle notification", "stick": "stick"},
                fresh_ns={"stick": stale},
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
                tell_signal,
                {"vibrotactors": encode_signal},
                links={
                    "obstacles": "Obstacle notification",
                    "selected": "select_signal",
                    "merged": "merge_commands",
                    "troubles": "Sensor check",
                },
                constants=s.navigation,
                static=GloveLayout(sector_middles()),
            ),
        ],
        output="encode_packet",
    )
    root = Network(
        "Perceptual navigation",
        [
            sensor_check,
            obstacle_notification,
            doorway_navigation,
            free_space_finding,
            sensor_command_manager,
            navigation_command_manager,
        ],
        output="Navigation command manager",
    )
    return wire(root, SENSORS)
