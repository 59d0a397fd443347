"""The same cells with today's sensors: lidar, depth, borne-out echoes, ground and drop-offs, people, map and pose.

Each sensor's cell gives `Fans`, and the view is gathered from all of them: the Way finder is not told where it comes
from. Free space has 16 sectors by the outline that this chair sweeps. Doors come ranged (`planning`), so that the
validation of the paper is a check of their age and width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody, sonar_mounts
from waychair.control.behaviours.cell import Cell, Sensor
from waychair.control.behaviours.commands import (
    NULL,
    STOP,
    FreeCommand,
    FreeKind,
    sector_middles,
)
from waychair.control.behaviours.conditions import Active, AtLeast
from waychair.control.behaviours.doorway import (
    DoorCheck,
    DoorState,
    Doorway,
    OdometryPose,
    PathMemory,
    TrackerMemory,
    plan_path,
    track_door,
)
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.glove import GloveLayout, encode_signal
from waychair.control.behaviours.managers import (
    StickDirection,
    choose_signal,
    gate_signals,
    merge_commands,
    select_signal,
)
from waychair.control.behaviours.network import Network, Wiring, wire
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.paper_settings import DoorLimits, ObstacleLimits
from waychair.control.behaviours.sonar import LastClasses, Obstacle, ObstacleClasses, obstacle_class
from waychair.control.behaviours.view.local_view import (
    Beams,
    Fans,
    LocalView,
    MapPart,
    Thing,
    ViewMemory,
    gather_views,
)
from waychair.control.behaviours.view.swept_sectors import free_orientations
from waychair.types import Float32Array, Scan, SonarReadings

SECTORS = 16
"""Sectors of free space, 22.5 degrees each."""

_VIEW_NS = 100_000_000
"""Period of the view, that of the lidar; ways and classes follow it."""

_NOTHING_SEEN = 3.0
"""m; a beam without an echo is free up to here at most: dark things return none from farther away."""

_SPARSE = 0.25
"""Part of the beams that must have a range: below it a lidar is blind, and nothing is free by it."""

SONAR_RANGE, HALF_CONE = 4.0, math.radians(15.0)
"""m, rad; the sonars of `sonar_mounts`: farthest echo, and half the angle of the cone."""

_CONE_STEP = math.radians(2.0)
_STUCK_MOVED = 0.3
"""m; a sonar that reads the very same finite range while the chair moves by this is stuck."""


def lidar_fans(scan: Scan, constants: ChairBody) -> Fans | None:
    """Return a scan as a fan in base; None where the lidar is blind."""
    ranges = np.asarray(scan.ranges, np.float64)
    known = ~np.isnan(ranges) & (ranges > -np.inf)
    if not len(ranges) or np.isfinite(ranges).mean() < _SPARSE:
        return None
    mount = constants.base_from_laser
    far = np.where(np.isfinite(ranges), ranges, min(_NOTHING_SEEN, scan.range_max))[known]
    angles = scan.angles()[known] + mount.theta
    ends = np.column_stack([mount.x + far * np.cos(angles), mount.y + far * np.sin(angles)])
    hits = np.isfinite(ranges)[known] & (ranges[known] <= scan.range_max)
    return Fans((Beams(np.array([mount.x, mount.y]), ends, hits, abs(scan.angle_step) / 2),))


def pass_fans(part: Fans) -> Fans:
    """Return a part that comes ranged: depth at the body's heights, drop-offs, people."""
    return part


@dataclass(frozen=True, slots=True)
class EchoMemory:
    """Dynamic data of the echo view: the ranges before, and where the chair stood when each last changed."""

    ranges: tuple[float, ...] = ()
    changed_at: tuple[tuple[float, float], ...] = ()


def echo_fans(
    readings: SonarReadings, odometry: OdometryPose, constants: ChairBody, dynamic: EchoMemory
) -> tuple[Fans, EchoMemory]:
    """Return the borne-out echoes as fans, one for each sonar: the whole arc of an echo is hit.

    An echo counts as free ground before it only with a second one at its range (crosstalk comes alone), and not from a
    sonar that reads the very same range while the chair moves. An echo alone is still an obstacle.
    """
    values = tuple(float(each) for each in readings.ranges)
    here = odometry.x, odometry.y
    before = dynamic.ranges if len(dynamic.ranges) == len(values) else (math.nan,) * len(values)
    places = dynamic.changed_at if len(dynamic.changed_at) == len(values) else (here,) * len(values)
    changed_at = tuple(
        place if value == was else here for value, was, place in zip(values, before, places, strict=True)
    )
    fans = []
    for mount, value, was, place in zip(sonar_mounts(constants), values, before, changed_at, strict=False):
        stuck = math.isfinite(value) and math.hypot(here[0] - place[0], here[1] - place[1]) > _STUCK_MOVED
        if math.isnan(value) or stuck:
            continue
        confirmed = value == was or abs(value - was) <= 0.15
        distance = min(max(value, 0.0), SONAR_RANGE)
        bearings = mount.theta + np.arange(-HALF_CONE, HALF_CONE + 1e-9, _CONE_STEP)
        ends = np.column_stack([mount.x + distance * np.cos(bearings), mount.y + distance * np.sin(bearings)])
        hits = np.full(len(ends), value <= SONAR_RANGE)
        fans.append(Beams(np.array([mount.x, mount.y]), ends, hits, _CONE_STEP / 2, int(Thing.SOLID), confirmed))
    return Fans(tuple(fans)), EchoMemory(values, changed_at)


def view_classes(
    view: LocalView, constants: tuple[ObstacleLimits, ChairBody], dynamic: LastClasses
) -> tuple[ObstacleClasses, LastClasses]:
    """Return the class of the nearest obstacle in each of eight directions, measured from the outline.

    A direction of which less than half of the ground up to an immediate obstacle was seen, and that shows nothing, is
    unknown.
    """
    limits, body = constants
    middles = sector_middles()
    nearest, seen = _nearest(view, body, limits.immediate)
    before = dynamic.classes or (Obstacle.UNKNOWN,) * len(middles)
    classes = tuple(
        obstacle_class(float(nearest[k]) if math.isfinite(nearest[k]) or seen[k] else math.nan, before[k], limits)
        for k in range(len(middles))
    )
    return ObstacleClasses(classes), LastClasses(classes)


def _nearest(view: LocalView, body: ChairBody, near: float) -> tuple[Float32Array, Float32Array]:
    count = len(sector_middles())
    points, places = view.metres(), view.unseen_places()
    nearest = np.full(count, np.inf)
    outside = np.hypot(
        np.maximum(np.maximum(points[:, 0] - body.front, -body.rear - points[:, 0]), 0.0),
        np.maximum(np.abs(points[:, 1]) - body.width / 2, 0.0),
    )
    sectors = np.rint(np.arctan2(points[:, 1], points[:, 0]) / math.tau * count).astype(int) % count
    np.minimum.at(nearest, sectors[outside > 0.0], outside[outside > 0.0])
    within = np.hypot(places[:, 0], places[:, 1]) <= min(body.front, body.rear, body.width / 2) + near
    hidden = np.rint(np.arctan2(places[within, 1], places[within, 0]) / math.tau * count).astype(int) % count
    cells = np.bincount(hidden, minlength=count)
    return nearest.astype(np.float32), (cells < 20).astype(np.float32)


def find_swept_way(view: LocalView | None, constants: ChairBody) -> WayFound:
    """Return the orientations in which this chair can turn and drive off; without a view it did not look."""
    if view is None:
        return WayFound(NULL)
    free = free_orientations(view.metres(), view.margins(), view.unseen_places(), constants, SECTORS)
    middles = sector_middles(SECTORS)
    listed = tuple(middles[k] for k in range(SECTORS) if free[k])
    return WayFound(FreeCommand(FreeKind.LIST, listed, SECTORS) if listed else STOP)


@dataclass(frozen=True, slots=True)
class DoorSeen:
    """A doorway that was found in ranges, in base: the nearest one ahead; `width` is its clear width [m]."""

    door: Doorway


def check_door(seen: DoorSeen, constants: DoorLimits) -> DoorCheck:
    """Return a door of possible width as valid: its ranges have validated it."""
    if constants.narrowest <= seen.door.width <= constants.widest:
        return DoorCheck(DoorState.VALID, seen.door)
    return DoorCheck(DoorState.REFUTED)


SENSORS = (
    Sensor("lidar", Scan),
    Sensor("depth", Fans),
    Sensor("drop-offs", Fans),
    Sensor("sonars", SonarReadings),
    Sensor("people", Fans),
    Sensor("map round the chair", MapPart),
    Sensor("odometry", OdometryPose),
    Sensor("door seen", DoorSeen),
    Sensor("door wanted", bool),
    Sensor("stick", StickDirection),
)


def default_network(settings: PaperSettings | None = None, body: ChairBody = CHAIR_A) -> Wiring:
    """Return the network with today's sensors for a chair."""
    s = settings or PaperSettings()
    stale = round(s.obstacles.stale * 1e9)
    view = Network(
        "View",
        [
            Cell("Lidar view", lidar_fans, links={"scan": "lidar"}, triggers=("lidar",), constants=body),
            Cell("Depth view", pass_fans, links={"part": "depth"}, triggers=("depth",)),
            Cell("Ground view", pass_fans, links={"part": "drop-offs"}, triggers=("drop-offs",)),
            Cell(
                "Echo view",
                echo_fans,
                links={"readings": "sonars", "odometry": "odometry"},
                triggers=("sonars",),
                constants=body,
                dynamic=EchoMemory(),
            ),
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
                    "surroundings": "map round the chair",
                },
                fresh_ns={"odometry": stale, "surroundings": stale},
                constants=body,
                dynamic=ViewMemory(),
            ),
        ],
        output="Gathered view",
        every_ns=_VIEW_NS,
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
                "Door validation",
                check_door,
                links={"seen": "door seen"},
                fresh_ns={"seen": stale},
                constants=s.doors,
            ),
            Cell(
                "Object tracker",
                track_door,
                links={"check": "Door validation", "odometry": "odometry"},
                fresh_ns={"odometry": stale},
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
    free_space_finding = Network(
        "Free-space finding",
        [view, Cell("Way finder", find_swept_way, links={"view": "View"}, constants=body, triggers=("View",))],
        output="Way finder",
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
                choose_signal,
                {"vibrotactors": encode_signal},
                links={"obstacles": "Obstacle notification", "selected": "select_signal", "merged": "merge_commands"},
                constants=s.navigation,
                static=GloveLayout(sector_middles()),
            ),
        ],
        output="encode_packet",
    )
    root = Network(
        "Perceptual navigation",
        [obstacle_notification, doorway_navigation, free_space_finding, navigation_command_manager],
        output="Navigation command manager",
    )
    return wire(root, SENSORS)
