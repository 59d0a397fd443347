"""Approaches to doors of simulated buildings, and to doors that a chair must not be sent through, seen by one sensor.

The chair drives in a straight line towards a door's middle, at an angle to its normal. Its poses are those of odometry
with a drift of 1 % of the path and 0.2 degrees a metre. The tracker sees each view as on the chair.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evaluation.scenes.tight_places import door_scene
from waychair.calibration.chair_body import CHAIR_A, ChairBody, sonar_mounts
from waychair.control.behaviours.view.servo_cells import SWEEP
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.geometry import compose, in_space, transform_points
from waychair.maps.depth.depth_scan import DepthSettings, depth_scan
from waychair.maps.grid.cells import occupied
from waychair.maps.grid.distance_field import distances
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.planning.seen.laser_line import LINE_ERROR, LaserPlane, points_of_line
from waychair.planning.seen.laser_sight import FARTHEST as FARTHEST_LINE
from waychair.planning.seen.laser_sight import line_view
from waychair.planning.seen.range_views import RangeView, moved_view, view_from_depth, view_from_scan
from waychair.simulation.plan.world import ClosableDoor, World, load_world, shipped_worlds
from waychair.simulation.scene.scene import Block
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.renderer import Renderer, camera_matrix
from waychair.simulation.sensors.sonar import Sonars, SonarSettings
from waychair.types import BoolArray, Float32Array, FloatArray, Pose2, Twist

WIDTHS = (0.65, 1.30)
"""m; clear widths of the doors that count; wider ones are passages."""

FARTHEST, NEAREST, LEAST = 4.5, 1.0, 3.2
"""m before the door's middle: the start at the farthest, the end, and the start at the nearest."""

ROOM, STEP = 0.42, 0.10
"""m; free space round the path, and the path between two views."""

OFF_JAMB = 0.08
"""m; a doorway's middle is at least half its width less this from anything."""

STEEPEST = 70.0
"""degrees; largest angle between the path and the door's normal."""

DRIFT, TURN_DRIFT = 0.01, math.radians(0.2)
"""Share of the path, and rad a metre: error of odometry (one sigma)."""

Look = Callable[[Pose2, int], tuple[RangeView, Pose2]]
"""A sensor: from the chair's true pose and the number of the view to a view in the base frame, and the mount."""

Listen = Callable[[Pose2, int], FloatArray]
"""The sonars: from the chair's true pose and the number of the view to their ranges [m]."""

FOCAL, BASELINE, COLUMNS = 600.0, 0.10, 640
"""pixels, m, pixels: a camera with a laser below it whose plane is level."""

LINE_LOST = ((2.0, 0.0), (4.0, 0.01), (5.0, 0.1), (6.0, 0.15), (FARTHEST_LINE, 0.3))
"""m, share; so many points are lost up to so far, as four pairs of rendered pictures show at rest."""

JOINED = 5
"""Columns whose line is taken together, by the median: half a degree, as far apart as a lidar's beams."""

LOOK_EVERY = 2
"""Steps from one look by the laser's line to the next. The chair stands meanwhile: the servos turn and settle in 0.3 to
1.1 s, and four pairs of pictures take 0.8 s."""


@dataclass(frozen=True, slots=True)
class Approach:
    """A world, a door in it with its clear width [m], and the chair's true poses on the way to it."""

    world: World
    door: Pose2
    width: float
    path: tuple[Pose2, ...]


@dataclass(frozen=True, slots=True)
class ApproachOutcome:
    """An approach's outcome: distance [m] to the door when it was first offered (nan: never), the last estimate of it in
    odom, and whether any doorway near was ever said to be wide enough, or open."""

    first_m: float
    last: Doorway | None
    wide_enough: bool
    open: bool


def approaches(count: int, seed: int) -> list[Approach]:
    """Return approaches to the doors of all shipped worlds, in turn, as far as there is room for them."""
    rng = np.random.default_rng(seed)
    doors = []
    for name in shipped_worlds():
        world = load_world(name)
        field = distances(occupied(world.grid), world.grid.resolution)
        doors += [(world, field, door) for door in world.doors if WIDTHS[0] <= door.width <= WIDTHS[1]]
    found: list[Approach] = []
    tries = 0
    while len(found) < count and tries < 200 * count:
        world, field, door = doors[tries % len(doors)]
        tries += 1
        angle = math.radians(rng.uniform(-STEEPEST, STEEPEST))
        heading = door.middle.theta + rng.choice([1.0, -1.0]) * math.pi / 2 + angle
        path = _free_path(world, field, door.middle, door.width, heading)
        if path:
            found.append(Approach(world, _through(door), door.width, path))
    return found


def forbidden(count: int, seed: int, body: ChairBody = CHAIR_A) -> list[Approach]:
    """Return approaches to doors that the chair must not be sent through: too narrow, closed, or half open, in turn."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        kind = k % 3
        width = float(rng.uniform(0.45, body.width + 0.04) if kind == 0 else rng.uniform(0.75, 1.1))
        scene = door_scene(width, float(rng.uniform(0.0, 60.0)), body, int(rng.integers(1 << 30)))
        assert scene.door is not None
        world, middle, thick = scene.world, scene.door, 0.15
        if kind == 1:
            recess = float(rng.uniform(-thick / 2 + 0.02, thick / 2 - 0.02))
            world = _with(world, Block(middle @ Pose2(recess, 0.0, math.pi / 2), width, 0.04, 0.0, 2.1, "wood"))
        elif kind == 2:
            most = math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - body.width / width))))
            angle = math.radians(float(rng.uniform(5.0, most)))
            side, way = float(rng.choice([1.0, -1.0])), float(rng.choice([1.0, -1.0]))
            hinge = middle @ Pose2(way * thick / 2, side * width / 2)
            leaf = Pose2(0.5 * width * way * math.sin(angle), -0.5 * width * side * math.cos(angle))
            turn = math.atan2(leaf.y, leaf.x)
            at = Pose2(hinge.x, hinge.y, middle.theta) @ Pose2(leaf.x, leaf.y, turn)
            world = _with(world, Block(at, width, 0.04, 0.0, 2.1, "wood"))
        heading = middle.theta + math.radians(float(rng.uniform(-50.0, 50.0)))
        steps = np.arange(3.4, NEAREST, -STEP)
        path = tuple(Pose2(middle.x - s * math.cos(heading), middle.y - s * math.sin(heading), heading) for s in steps)
        found.append(Approach(world, middle, width, path))
    return found


def behind_glass(count: int, seed: int, body: ChairBody = CHAIR_A) -> list[Approach]:
    """Return approaches to doors whose leaf is a pane of glass, closed, at 0 to 40 degrees, to half a metre before it."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        width = float(rng.uniform(0.8, 1.1))
        scene = door_scene(width, 0.0, body, int(rng.integers(1 << 30)))
        assert scene.door is not None
        middle = scene.door
        pane = Block(middle @ Pose2(float(rng.uniform(-0.05, 0.05)), 0.0, math.pi / 2), width, 0.02, 0.0, 2.1, "glass")
        heading = middle.theta + math.radians(float(rng.uniform(-40.0, 40.0)))
        steps = np.arange(3.2, body.front + 0.2, -STEP)
        path = tuple(Pose2(middle.x - s * math.cos(heading), middle.y - s * math.sin(heading), heading) for s in steps)
        found.append(Approach(_with(scene.world, pane), middle, width, path))
    return found


def approach(
    case: Approach, looks: dict[str, Look], seed: int, body: ChairBody = CHAIR_A, listen: Listen | None = None
) -> ApproachOutcome:
    """Drive one approach with sensors by name, and perhaps sonars, and return what the tracker found."""
    rng, tracker = np.random.default_rng(seed), DoorwayTracker()
    scale, bend = 1.0 + DRIFT * rng.standard_normal(), TURN_DRIFT * rng.standard_normal()
    odom, before = case.path[0], case.path[0]
    first, last, said, opened = math.nan, None, False, False
    mounts = [mount.array() for mount in sonar_mounts(body)]
    for number, true in enumerate(case.path):
        step = before.inverse() @ true
        odom, before = odom @ Pose2(scale * step.x, step.y, step.theta + bend * math.hypot(step.x, step.y)), true
        for name, look in looks.items():
            if name == "laser" and number % LOOK_EVERY:
                continue
            view, mount = look(true, number)
            tracker.see(moved_view(view, odom), odom @ mount, number * 100_000_000, name)
        if listen is not None:
            tracker.hear(compose(odom.array(), np.array(mounts)), listen(true, number))
        here = true @ odom.inverse()  # map_from_odom
        away = math.hypot(case.door.x - true.x, case.door.y - true.y)
        mine = [door for door in tracker.doorways if door.validated and _is(here @ door.pose, case.door)]
        if mine:
            first, last = (away if math.isnan(first) else first), mine[0]
        near = [door for door in tracker.doorways if _near(here @ door.pose, case.door)]
        said = said or any(door.wide_enough(body.width) for door in near)
        opened = opened or any(door.state is DoorState.OPEN for door in near)
    return ApproachOutcome(first, last, said, opened)


def lidar_look(world: World, seed: int, body: ChairBody = CHAIR_A) -> Look:
    """Return the simulator's lidar in a world, with its noise and faults, at rest at each pose."""
    lidar = Lidar(LidarSettings(), body, np.random.default_rng(seed))
    scenery, mount = scenery_from_slice(slice_at(world.blocks, body.laser_z)), body.base_from_laser

    def look(pose: Pose2, number: int) -> tuple[RangeView, Pose2]:
        return view_from_scan(lidar.scan_at_rest(scenery, pose, number * 100_000_000), mount), mount

    return look


def sonar_listen(world: World, seed: int, body: ChairBody = CHAIR_A) -> Listen:
    """Return the simulator's sonars in a world, with their noise and cross-talk."""
    settings = SonarSettings()
    sonars = Sonars(settings, body, np.random.default_rng(seed))
    scenery = scenery_from_slice(slice_at(world.blocks, settings.height))
    return lambda pose, number: sonars.read(scenery, pose, (), number * 100_000_000).ranges.astype(np.float64)


def laser_look(world: World, seed: int, body: ChairBody = CHAIR_A) -> Look:
    """Return a laser line's points: what its level plane meets, with the error of the line in the picture and its losses.

    Camera and laser look into the ways of the Way finder's sweep in turn.
    """
    rng = np.random.default_rng(seed)
    half = math.atan(COLUMNS / 2 / FOCAL)
    settings = LidarSettings(beams=COLUMNS, field_of_view=2.0 * half, sigma=0.0, faults=False, sweep_s=0.0)
    plane, mount = Lidar(settings, body, rng), body.base_from_laser
    scenery = scenery_from_slice(slice_at(world.blocks, body.laser_z))
    matrix = np.array([[FOCAL, 0.0, COLUMNS / 2], [0.0, FOCAL, 240.0], [0.0, 0.0, 1.0]])

    def look(pose: Pose2, number: int) -> tuple[RangeView, Pose2]:
        pan = Pose2(0.0, 0.0, SWEEP[number // LOOK_EVERY % len(SWEEP)])
        base_from_camera = mount @ pan
        turned = pose @ base_from_camera @ mount.inverse()  # the lidar that stands for the laser looks where it does
        scan = plane.scan_at_rest(scenery, turned, number * 100_000_000)
        ahead = scan.ranges * np.cos(scan.angles())
        ahead[~np.isfinite(ahead) | (ahead < 0.2)] = np.nan
        columns = COLUMNS / 2 - FOCAL * np.tan(scan.angles())
        rows = 240.0 + FOCAL * BASELINE / ahead + LINE_ERROR * rng.standard_normal(COLUMNS)
        pixels = np.median(np.stack([columns, rows], axis=1).reshape(-1, JOINED, 2), axis=1)
        lit = points_of_line(pixels, matrix, LaserPlane(np.array([0.0, 1.0, 0.0]), BASELINE))
        shown = _is_shown(lit.points[:, 2], rng)
        ends = np.stack([lit.points[shown, 2], -lit.points[shown, 0]], axis=1)
        origin = np.array([base_from_camera.x, base_from_camera.y])
        view = line_view(origin, transform_points(base_from_camera, ends), lit.errors[shown])
        return view, base_from_camera

    return look


def _is_shown(away: FloatArray, rng: np.random.Generator) -> BoolArray:
    """Return which points (N,) [m] ahead of the camera the pictures show; others are lost by chance, as `LINE_LOST`."""
    shares = np.array([lost for _, lost in (*LINE_LOST, (math.inf, 1.0))])
    part = np.searchsorted([far for far, _ in LINE_LOST], np.nan_to_num(away, nan=math.inf))
    shown: BoolArray = rng.random(len(away)) >= shares[part]
    return shown


def depth_look(world: World, seed: int, body: ChairBody = CHAIR_A) -> Look:
    """Return the simulator's depth camera in a world, with its noise, at rest at each pose.

    Raises:
        MissingExtra: this machine cannot render pictures.
    """
    settings = CameraSettings()
    matrix = camera_matrix(settings.width, settings.height, settings.field_of_view)
    renderer = Renderer(world, matrix, settings.width, settings.height)
    camera = RgbdCamera(settings, body.base_from_camera, np.random.default_rng(seed), renderer)

    def look(pose: Pose2, number: int) -> tuple[RangeView, Pose2]:
        frame = camera.frame(number * 100_000_000, in_space(pose), Twist())
        seen = depth_scan(frame, body.base_from_camera, np.eye(3), body.front, DepthSettings())
        return view_from_depth(seen, Pose2()), Pose2(float(seen.origin[0]), float(seen.origin[1]), 0.0)

    return look


def _free_path(world: World, field: Float32Array, middle: Pose2, width: float, heading: float) -> tuple[Pose2, ...]:
    """Return the poses on the straight line to a door as far as the chair has room, the farthest first."""
    kept: list[Pose2] = []
    if not _has_room(world, field, middle, width / 2 - OFF_JAMB):
        return ()  # something stands in the doorway
    for s in np.arange(0.0, 1.5, STEP / 2):
        if not _has_room(
            world, field, Pose2(middle.x - s * math.cos(heading), middle.y - s * math.sin(heading)), OFF_JAMB
        ):
            return ()  # a wall stands between
    for s in np.arange(NEAREST, FARTHEST, STEP):
        pose = Pose2(middle.x - s * math.cos(heading), middle.y - s * math.sin(heading), heading)
        if _has_room(world, field, pose, ROOM):
            kept.append(pose)
        elif s > 1.5:
            break
        else:
            kept.clear()
    far = kept and math.hypot(kept[-1].x - middle.x, kept[-1].y - middle.y) >= LEAST
    return tuple(reversed(kept)) if far else ()


def _has_room(world: World, field: Float32Array, pose: Pose2, room: float) -> bool:
    """Return whether nothing stands within `room` [m] of a place."""
    at = world.grid.map_from_grid.inverse() @ pose
    row, column = int(at.y / world.grid.resolution), int(at.x / world.grid.resolution)
    return 0 <= row < field.shape[0] and 0 <= column < field.shape[1] and bool(field[row, column] >= room)


def _through(door: ClosableDoor) -> Pose2:
    return Pose2(door.middle.x, door.middle.y, door.middle.theta + math.pi / 2)


def _with(world: World, block: Block) -> World:
    return replace(world, blocks=(*world.blocks, block))


def _is(pose: Pose2, door: Pose2) -> bool:
    turned = abs(math.remainder(pose.theta - door.theta, math.pi))
    return math.hypot(pose.x - door.x, pose.y - door.y) < 0.3 and turned < math.radians(20.0)


def _near(pose: Pose2, door: Pose2) -> bool:
    return math.hypot(pose.x - door.x, pose.y - door.y) < 0.8


def share(values: Sequence[bool]) -> float:
    """Return the share of true values; nan of none."""
    return float(np.mean(values)) if values else math.nan
