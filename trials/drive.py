"""A chair in a simulator drives to places, one after the other; everything that a report or a score needs is kept.

Between the chair and the simulated lines stands the shipped firmware as a program: what drives here is what would.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.chair import ChairBody
from waychair.calibration.dac import DacModel
from waychair.calibration.stopping import StopTable
from waychair.control.navigator import Stage
from waychair.firmware_bridge.board import BoardSettings, HostBoard, board_program
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.geometry import wrap_angle
from waychair.maps.zones import Zone
from waychair.runtime.black_box import About, BlackBox
from waychair.runtime.chair import Chair, ChairSettings, ChairState, ChairWatcher
from waychair.simulation.follower import Follower, Progress
from waychair.simulation.simulator import SensorMessage, Simulator
from waychair.slam.localiser import LocalisationState
from waychair.topics import COMMAND
from waychair.trials.simulated_stops import simulated_calibration
from waychair.types import FloatArray, Goal, JoystickInput, OccupancyGrid, Place, Pose2

TICK_NS = round(1e9 / COMMAND.rate_hz)
BEAT_NS = 10_000_000
"""The board is kept company this often; a tick is a whole number of them."""

_STANDING = 0.01
"""Sum of speed and turning [m/s, rad/s] below which a chair stands."""

Heard = Callable[[tuple[SensorMessage, ...], ChairState], None]
"""Told of each tick's messages and what came of them, once it is over."""

READY_S = 5.0
"""A chair that was switched on has heard of its board, its lidar and its place by then."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One drive to a place.

    `reached`: the chair says so and, by the truth, stands within the place's tolerances, `error_m` and `error_rad`
    away. `planned` (N, 3) is the first path, `truth` (T, 3) the way driven, `estimate` (T, 3) where the chair believed
    to be, all in map; `times_s` (T,), `volts` (T, 2) of the forward and turn lines (those of a released line are the
    neutral), `commands` (T, 2) [m/s, rad/s], `clearance` (T,) [m] from the outline to the nearest wall.
    """

    place: str
    reached: bool
    reason: str
    error_m: float
    error_rad: float
    contacts: int
    plans: int
    planned: FloatArray
    times_s: FloatArray
    truth: FloatArray
    estimate: FloatArray
    volts: FloatArray
    commands: FloatArray
    clearance: FloatArray
    tick_ms: FloatArray

    @property
    def distance_m(self) -> float:
        """Way driven [m]."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())

    @property
    def duration_s(self) -> float:
        """Time from the goal to the end [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def localisation_error_m(self) -> float:
        """Root mean square distance of the believed to the true position [m]."""
        return float(np.sqrt((np.hypot(*(self.truth - self.estimate)[:, :2].T) ** 2).mean()))


@dataclass(frozen=True, slots=True)
class Setting:
    """What a drive takes place in: the map the chair knows, its places, the chair, and `map_from_world` of the truth.

    `stops` None: as the simulated chair's are; a chair whose stops were not measured crawls. `zones` are the map's,
    `scanned` is the map as a lidar sees it, where that is another.
    """

    grid: OccupancyGrid
    places: Mapping[str, Place]
    body: ChairBody
    calibration: DacModel
    map_from_world: Pose2 = field(default_factory=Pose2)
    chair: ChairSettings = field(default_factory=ChairSettings)
    stops: StopTable | None = None
    zones: Sequence[Zone] = ()
    scanned: OccupancyGrid | None = None


def drive_to_places(
    setting: Setting,
    simulator: Simulator,
    goals: Sequence[str],
    time_limit_s: float = 300.0,
    progress: Callable[[float], None] | None = None,
    box: Path | None = None,
) -> tuple[Leg, ...]:
    """Drives to the named places in turn, each leg at most `time_limit_s` of simulated time.

    `box`: folder of the black box that logs it, for `waychair why`.

    Raises:
        BoxError: the black box cannot be written, or another program writes it.
        UnknownPlace: a goal is not among the places.
        BoardBuildError: the firmware cannot be built here, for want of a C compiler.
    """
    legs = []
    with black_box(setting, box) as watcher, chair_in(setting, simulator, watcher) as chair:
        for index, goal in enumerate(goals):
            legs.append(drive_leg(setting, simulator, chair, goal, time_limit_s))
            if progress is not None:
                progress((index + 1) / len(goals))
    return tuple(legs)


def black_box(setting: Setting, folder: Path | None) -> AbstractContextManager[BlackBox | None]:
    """The black box of a chair in a setting; none without a folder."""
    if folder is None:
        return nullcontext()
    return BlackBox(folder, About(setting.chair, calibration_of(setting), setting.places))


@contextmanager
def chair_in(
    setting: Setting,
    simulator: Simulator,
    watcher: ChairWatcher | None = None,
    tapped: Callable[[Transport], Transport] = lambda transport: transport,
    told: bool = True,
) -> Iterator[Chair]:
    """A chair where the simulated one stands, cabled to a board that is wired into it for as long as the block lasts.

    `watcher` looks on; see `Chair`. `tapped` may put something into the cable. The chair is `told` where it stands, or
    has to find out.

    Raises:
        BoardBuildError: the firmware cannot be built here, for want of a C compiler.
    """
    start = setting.map_from_world @ simulator.truth()
    with HostBoard(board_program(), board_settings(setting)) as board:
        simulator.wire(board)
        cable = Reconnecting(lambda: tapped(board.transport))
        try:
            yield Chair(
                setting.grid,
                setting.places,
                calibration_of(setting),
                cable,
                start if told else None,
                setting.chair,
                setting.calibration,
                zones=setting.zones,
                scanned=setting.scanned,
                watcher=watcher,
            )
        finally:
            simulator.wire(None)


def calibration_of(setting: Setting) -> ChairCalibration:
    """What would be in the chair's file."""
    return simulated_calibration(setting.body, setting.stops)


def begin(simulator: Simulator, chair: Chair, goal: Goal) -> None:
    """Ask for a goal and confirm it, once the chair is ready; one that is not within `READY_S` drops the goal."""
    for _ in range(round(READY_S * COMMAND.rate_hz)):
        if chair.ready:
            break
        messages = advance_tick(simulator, chair)  # first, or the chair's clock would be a tick behind its sensors
        chair.step(simulator.now_ns, messages)
    chair.go(goal)
    chair.confirm()


def board_settings(setting: Setting) -> BoardSettings:
    """The board that belongs to a chair: its name, joystick family, converter, and the rider's way of taking over."""
    supervisor = setting.chair.supervisor
    return BoardSettings(
        chair_id=setting.body.chair_id,
        family=setting.chair.bridge.family,
        dac_bits=max(8, setting.calibration.counts_max.bit_length()),
        neutral_per_mille=round(1000 * supervisor.at_rest),
        override_per_mille=round(1000 * supervisor.override),
        override_ms=supervisor.override_ms,
    )


def advance_tick(simulator: Simulator, chair: Chair) -> tuple[SensorMessage, ...]:
    """The messages of one tick, during which the board is kept company."""
    messages: list[SensorMessage] = []
    for _ in range(TICK_NS // BEAT_NS):
        chair.beat(simulator.now_ns)
        messages += simulator.advance(BEAT_NS)
    return tuple(messages)


@dataclass(frozen=True, slots=True)
class Found:
    """How long [s] and how far [m] a rider drove until the chair knew where it was; whether it ever did."""

    found: bool
    seconds: float
    metres: float


def find_itself(
    simulator: Simulator, chair: Chair, follower: Follower, heard: Heard = lambda messages, state: None
) -> Found:
    """A rider drives along a route by joystick until the chair knows where it is, and lets it come to rest.

    Raises:
        WorldError: the chair touched something on the way, or made no way for a minute.
    """
    began_ns, metres, last = simulator.now_ns, 0.0, simulator.truth()
    progress = Progress(simulator)
    while True:
        messages = advance_tick(simulator, chair)
        state = chair.step(simulator.now_ns, messages)
        heard(messages, state)
        pose = simulator.truth()
        metres, last = metres + math.dist((pose.x, pose.y), (last.x, last.y)), pose
        found = state.localisation is not None and state.localisation.state is LocalisationState.OK
        seconds = (simulator.now_ns - began_ns) * 1e-9
        if found or follower.done:
            break
        progress.check()
        forward, turn = follower.stick(pose, simulator.body, simulator.people)
        simulator.rider = JoystickInput(simulator.now_ns, forward, turn)
    simulator.rider = JoystickInput(simulator.now_ns)
    while abs(simulator.twist().v) + abs(simulator.twist().omega) > _STANDING:
        messages = advance_tick(simulator, chair)
        heard(messages, chair.step(simulator.now_ns, messages))
    return Found(found, seconds, metres)


def drive_leg(
    setting: Setting,
    simulator: Simulator,
    chair: Chair,
    goal: str,
    time_limit_s: float = 300.0,
    heard: Heard = lambda messages, state: None,
) -> Leg:
    """Drives to one named place; see `drive_to_places`."""
    begin(simulator, chair, Goal(goal))
    began_ns, contacts = simulator.now_ns, simulator.contacts
    states: list[ChairState] = []
    truth, clearance, ticks, planned = [], [], [], np.empty((0, 3))
    while simulator.now_ns - began_ns < time_limit_s * 1e9:
        messages = advance_tick(simulator, chair)
        started = time.perf_counter()
        state = chair.step(simulator.now_ns, messages)
        ticks.append(1e3 * (time.perf_counter() - started))
        heard(messages, state)
        states.append(state)
        truth.append((setting.map_from_world @ simulator.truth()).array())
        clearance.append(simulator.clearance())
        if not len(planned) and state.navigation.path is not None:
            planned = state.navigation.path.poses
        if state.navigation.stage in (Stage.ARRIVED, Stage.FAILED):
            break
    place, last = setting.places[goal], states[-1]
    error_m = math.hypot(truth[-1][0] - place.pose.x, truth[-1][1] - place.pose.y)
    error_rad = abs(wrap_angle(truth[-1][2] - place.pose.theta))
    arrived = last.navigation.stage is Stage.ARRIVED
    ended = last.navigation.stage in (Stage.ARRIVED, Stage.FAILED)
    reason = last.navigation.reason if ended else last.verdict.reason or "the time is up"
    return Leg(
        place=goal,
        reached=arrived and error_m <= place.tolerance_m and error_rad <= place.tolerance_rad,
        reason=reason,
        error_m=error_m,
        error_rad=error_rad,
        contacts=simulator.contacts - contacts,
        plans=last.navigation.plans,
        planned=planned,
        times_s=np.array([state.stamp_ns for state in states]) * 1e-9,
        truth=np.array(truth),
        estimate=np.array([state.map_from_base.array() for state in states]),
        volts=np.array([[state.sent.forward_volts, state.sent.turn_volts] for state in states]),
        commands=np.array([[state.navigation.twist.v, state.navigation.twist.omega] for state in states]),
        clearance=np.array(clearance),
        tick_ms=np.array(ticks),
    )
