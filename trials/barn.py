"""The BARN benchmark: a robot drives through a field of cylinders to a goal straight ahead, by lidar and without a map.

Source: Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020, and the rules of its
challenge. The goal lies 10 m ahead; a run succeeds within 1 m of it. A contact or 100 s end the run; the clock starts
after the first 0.1 m. A success scores OT / clip(AT, 2 OT, 8 OT), where AT is the time taken and OT the time of the
reference path at 2 m/s.

A small loop replaces the whole chair, so that a thousand runs take minutes. The body follows the commands after a delay
and within the acceleration limits. Rays are exact, among exact cylinders, with noise on the ranges. The odometry has
scale errors. The navigator is the shipped one.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from waychair import config
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.control.drive.mapless import MaplessNavigator, MaplessSettings
from waychair.control.drive.navigator import Stage
from waychair.control.drive.recovery import RecoverySettings
from waychair.errors import ConfigError, WorldError
from waychair.files import is_folder
from waychair.geometry import arc
from waychair.maps.grid.occupancy import OccupancySettings
from waychair.planning.body.clearance import ClearanceSettings
from waychair.planning.window.motion_limits import DwaSettings
from waychair.simulation.plan.imports import BarnEnvironment, read_barn
from waychair.simulation.scene.scene import Slice
from waychair.simulation.scene.seeds import seed_from_names
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.topics import COMMAND
from waychair.trials.worker_pool import worker_pool
from waychair.types import FloatArray, Json, Pose2, Twist

TICK_NS = round(1e9 / COMMAND.rate_hz)
PERIOD = TICK_NS * 1e-9
_STEPS = 5  # positions per tick that are checked for contact

JACKAL = ChairBody(
    chair_id="jackal",
    drive="mid",
    length=0.508,
    width=0.43,
    axle_from_rear=0.254,
    track=0.376,
    wheel_radius=0.098,
    laser_x=0.12,
    laser_z=0.30,
)
"""The benchmark's robot. Its footprint counts for contacts; wheels and lidar are roughly as in the maker's drawings."""

OUTCOMES = ("success", "contact", "timeout")

ROBOTS: Mapping[str, ChairBody] = MappingProxyType({"jackal": JACKAL, "A": CHAIR_A, "B": CHAIR_B})
"""The robots that the benchmark can run."""


# The rules of the challenge.
GOAL_TOLERANCE = 1.0  # m; a run succeeds within this distance of the goal
TIME_LIMIT_S = 100.0  # from the first motion
CLOCK_FROM = 0.1  # m; the clock starts after this displacement
OPTIMAL_SPEED = 2.0  # m/s; the reference path's time is its length over this speed

# Errors of the simulated robot.
START_OFFSET = 0.10  # m; greatest offset of a start, in x and y
START_TURN = math.radians(10.0)  # rad; greatest turn of a start
ODOMETRY_SCALE = 0.005  # error of distance and turn, one sigma over runs
LIDAR = LidarSettings(rate_hz=COMMAND.rate_hz, sweep_s=0.0, faults=False)
"""A lidar whose only error is the noise of its ranges."""


@dataclass(frozen=True, slots=True)
class BarnRun:
    """The result of one run. `outcome` is one of `OUTCOMES`; a navigator that gives up counts as a timeout.

    `time_s` counts from the first motion. `clearance_m` is the least of the run, at most the lidar's range. `truth`
    (T, 3) [m, m, rad] is the path driven, in the world frame.
    """

    world: str
    start: int
    outcome: str
    time_s: float
    score: float
    distance_m: float
    clearance_m: float
    plans: int
    reason: str
    truth: FloatArray


@dataclass(frozen=True, slots=True)
class BarnTask:
    """The runs to make: which of `ROBOTS`, its top speed, the scale of the worlds, and the runs per world.

    `changes` are values of `MaplessSettings` that replace the benchmark's (see `config.changed_values`), except for the
    top speed.
    """

    body: str = "jackal"
    speed: float = 0.5  # m/s, 0.1 to 3
    scale: float = 1.0  # of all lengths, 0.1 to 10
    starts: int = 1  # 1 to 1000
    changes: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for name, low, high in (("speed", 0.1, 3.0), ("scale", 0.1, 10.0), ("starts", 1, 1000)):
            if not low <= getattr(self, name) <= high:
                raise ConfigError(f"{name} is {getattr(self, name)}: take {low:g} to {high:g}")
        if self.body not in ROBOTS:
            raise ConfigError(f"unknown body '{self.body}': take {', '.join(ROBOTS)}")

    def navigator(self) -> MaplessSettings:
        """Return the navigator's settings: the benchmark's with the changes."""
        settings = config.with_values(navigator_settings(ROBOTS[self.body], self.speed, self.scale), self.changes)
        return replace(settings, dwa=replace(settings.dwa, max_speed=self.speed))


def worlds_in(folder: Path, count: int | None = None) -> list[Path]:
    """Return the world files of a folder or its subfolder `worlds`, sorted by name; `count` picks evenly spread ones.

    Raises:
        WorldError: the folder does not exist or holds no worlds, or `count` is less than 1.
    """
    if count is not None and count < 1:
        raise WorldError(f"{count} worlds were requested: request at least one")
    if not is_folder(folder, WorldError):
        raise WorldError(f"there is no folder '{folder}': give the folder of the BARN text grids")
    inner = folder / "worlds"
    found = sorted((inner if is_folder(inner, WorldError) else folder).glob("world_*.txt"))
    if not found:
        raise WorldError(f"{folder} holds no world_*.txt: give the folder of the BARN text grids")
    if count is None or count >= len(found):
        return found
    return [found[i] for i in np.linspace(0, len(found) - 1, count).round().astype(int)]


def run_worlds(
    paths: Sequence[Path], task: BarnTask, jobs: int = 1, progress: Callable[[float], None] | None = None
) -> list[BarnRun]:
    """Run all starts of all worlds and return the runs in order.

    `jobs` is the number of processes, at most one per world; results do not depend on it.

    Raises:
        WorldError: a file is no BARN world.
        WorkerLost: a process was killed from outside.
    """
    environments = [read_barn(path, task.scale) for path in paths]
    runs: list[BarnRun] = []
    with _workers(min(jobs, len(environments))) as each:
        for row in each(partial(_all_starts, task=task), environments):
            runs += row
            if progress is not None:
                progress(len(runs) / (len(environments) * task.starts))
    return runs


def report(runs: Sequence[BarnRun], task: BarnTask) -> Json:
    """Return means over all runs and a row per world; shares in [0, 1], `contact_below` with 95 % confidence."""
    shares = {outcome: _share(runs, outcome) for outcome in OUTCOMES}
    worlds = {run.world: [other for other in runs if other.world == run.world] for run in runs}
    return {
        "body": task.body,
        "speed": task.speed,
        "scale": task.scale,
        "runs": len(runs),
        "score": float(np.mean([run.score for run in runs])),
        **shares,
        "contact_below": upper_bound(sum(run.outcome == "contact" for run in runs), len(runs)),
        "time_s": float(np.mean([run.time_s for run in runs])),
        "least_clearance_m": min(run.clearance_m for run in runs),
        "worlds": [
            {
                "world": world,
                "score": float(np.mean([run.score for run in rows])),
                **{outcome: _share(rows, outcome) for outcome in OUTCOMES},
                "time_s": float(np.mean([run.time_s for run in rows])),
                "least_clearance_m": min(run.clearance_m for run in rows),
            }
            for world, rows in worlds.items()
        ],
    }


def upper_bound(count: int, trials: int) -> float:
    """Return the one-sided 95 % upper bound of a share (Clopper and Pearson, Biometrika 26, 1934)."""
    from scipy.stats import beta

    return 1.0 if count >= trials else float(beta.ppf(0.95, count + 1, trials - count))


def navigator_settings(body: ChairBody, speed: float, scale: float) -> MaplessSettings:
    """Return the navigator's settings: the benchmark's limits for the Jackal, comfortable limits for a chair."""
    dwa = replace(DwaSettings(), max_speed=speed)
    if body is JACKAL:
        dwa = replace(
            dwa,
            acceleration=2.0,
            braking=2.0,
            alpha=3.0,
            max_omega=1.5,
            max_lateral=1.5,
            max_wheel_speed=speed + 0.3,
            reaction_time=PERIOD,
        )
    cell = 0.025 * max(scale, 1.0)
    reach = 5.0 * max(scale, 1.0)
    occupancy = OccupancySettings(resolution=cell, range_max=reach, open_range=reach)
    return MaplessSettings(
        memory=occupancy,
        clearance=ClearanceSettings(comfortable=0.6 * scale),
        # no people here, so waiting for the path to clear is useless
        recovery=RecoverySettings(wait=0.5, progress_time=5.0, tries=20, patience=60.0),
        dwa=dwa,
    )


def run_barn(
    environment: BarnEnvironment,
    start: int,
    body: ChairBody,
    navigator: MaplessSettings,
    time_limit_s: float = TIME_LIMIT_S,
) -> BarnRun:
    """Run one world from start number `start`, which seeds the start offset, the noise and the odometry errors."""
    rng = np.random.default_rng(seed_from_names("barn", environment.name, start))
    truth = environment.start @ _start_error(rng)
    distance_scale, turn_scale = (1.0 + ODOMETRY_SCALE * rng.standard_normal(2)).tolist()
    lidar = Lidar(LIDAR, body, rng)
    scenery = scenery_from_slice(Slice(np.empty((0, 4)), np.empty(0, np.int64)))
    odom = Pose2()
    chair = MaplessNavigator(body, odom, truth.inverse() @ environment.goal, navigator)
    pending = deque([Twist()] * round(navigator.dwa.reaction_time / PERIOD))
    poses, began, now_ns, outcome, clearance, plans, reason = (
        [truth],
        None,
        0,
        "timeout",
        LIDAR.range_max,
        0,
        "",
    )
    while outcome == "timeout" and (began is None or (now_ns - began) * 1e-9 < time_limit_s):
        if began is None and now_ns * 1e-9 > time_limit_s:
            break
        scan = lidar.scan_at_rest(scenery, truth, now_ns, environment.cylinders)
        navigation = chair.step(now_ns, odom, scan)
        plans, reason = navigation.plans, navigation.reason
        pending.append(navigation.twist)
        twist = pending.popleft()
        distance, turn = twist.v * PERIOD, twist.omega * PERIOD
        for share in range(1, _STEPS + 1):
            passed = truth @ arc(distance * share / _STEPS, turn * share / _STEPS)
            clearance = min(clearance, clearance_among(environment.cylinders, body, passed))
        truth, odom = truth @ arc(distance, turn), odom @ arc(distance * distance_scale, turn * turn_scale)
        now_ns += TICK_NS
        poses.append(truth)
        if began is None and _distance(truth, poses[0]) >= CLOCK_FROM:
            began = now_ns
        if clearance <= 0.0:
            outcome = "contact"
        elif _distance(truth, environment.goal) <= GOAL_TOLERANCE:
            outcome = "success"
        elif navigation.stage is Stage.FAILED:
            break
    time_s = (now_ns - (began or 0)) * 1e-9
    optimal = environment.path_length / OPTIMAL_SPEED
    score = optimal / min(max(time_s, 2 * optimal), 8 * optimal) if outcome == "success" else 0.0
    driven = np.array([pose.array() for pose in poses])
    return BarnRun(
        world=environment.name,
        start=start,
        outcome=outcome,
        time_s=time_s,
        score=score,
        distance_m=float(np.hypot(*np.diff(driven[:, :2], axis=0).T).sum()),
        clearance_m=clearance,
        plans=plans,
        reason=reason,
        truth=driven,
    )


def clearance_among(cylinders: FloatArray, body: ChairBody, pose: Pose2) -> float:
    """Return the exact distance [m] from the footprint to the nearest cylinder; 0 in contact, +inf if there is none."""
    if len(cylinders) == 0:
        return math.inf
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    x, y = cylinders[:, 0] - pose.x, cylinders[:, 1] - pose.y
    along, across = c * x + s * y, c * y - s * x
    beyond_end = np.maximum(np.maximum(along - body.front, -body.rear - along), 0.0)
    beyond_side = np.maximum(np.abs(across) - body.width / 2, 0.0)
    return float(max((np.hypot(beyond_end, beyond_side) - cylinders[:, 2]).min(), 0.0))


@contextmanager
def _workers(jobs: int) -> Iterator[Callable[..., Iterator[list[BarnRun]]]]:
    """Yield a function like `map` that runs in this process or on worker processes."""
    if jobs <= 1:
        yield map
        return
    with worker_pool(jobs) as pool:
        yield pool.map


def _all_starts(environment: BarnEnvironment, task: BarnTask) -> list[BarnRun]:
    body = ROBOTS[task.body]
    navigator = task.navigator()
    return [run_barn(environment, start, body, navigator) for start in range(task.starts)]


def _share(runs: Sequence[BarnRun], outcome: str) -> float:
    return sum(run.outcome == outcome for run in runs) / len(runs)


def _distance(first: Pose2, second: Pose2) -> float:
    return math.hypot(first.x - second.x, first.y - second.y)


def _start_error(rng: np.random.Generator) -> Pose2:
    x, y, theta = (rng.uniform(-1.0, 1.0, 3) * (START_OFFSET, START_OFFSET, START_TURN)).tolist()
    return Pose2(x, y, theta)
