"""Drives of a complete chair in a simulator to places, one after the other, with records for reports and scores.

The shipped firmware runs as a program between the chair and the simulated lines, so the real software drives here.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DacModel
from waychair.calibration.fits.stopping import StopTable
from waychair.control.drive.navigator import Stage
from waychair.firmware_bridge.board import BoardSettings, HostBoard, board_program
from waychair.firmware_bridge.bridge import USUAL_FAMILY
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.garbage import present_left_out
from waychair.geometry import wrap_angle
from waychair.maps.drawn.zones import Zone
from waychair.runtime.black_box.cell_traces import CellTraceFile
from waychair.runtime.black_box.recorder import BlackBox, LoggedChair
from waychair.runtime.chair import Chair, ChairSettings, ChairState, ChairWatcher, Watchers
from waychair.runtime.haptics.haptic_guide import HapticGuide
from waychair.simulation.follower import Follower, StallCheck
from waychair.simulation.simulated_chair import SimulatedChair
from waychair.simulation.simulator import Simulator
from waychair.slam.localising.localiser import LocalisationState
from waychair.topics import COMMAND
from waychair.trials.simulated_stops import simulated_calibration
from waychair.types import FloatArray, Goal, JoystickInput, OccupancyGrid, Place, Pose2, SensorMessage, ServoMessage

TICK_NS = round(1e9 / COMMAND.rate_hz)
BEAT_NS = 10_000_000
"""Period of the heartbeats to the board; a tick is a whole number of them."""

_STANDING = 0.01
"""A chair stands when the sum of its speed and turn rate [m/s, rad/s] is below this."""

TickCallback = Callable[[tuple[SensorMessage, ...], ChairState], None]
"""A callback after each tick, with the tick's messages and the chair's state."""

READY_S = 5.0
"""Within this time after start the chair has a board, a lidar and a pose."""

ARMED_S = 5.0
"""Within this time a board is armed for a drive, whose rider lets the stick rest."""


@dataclass(frozen=True, slots=True)
class DriveRecord:
    """The record of one drive to a place.

    `reached`: the chair reports its arrival and truly stands within the place's tolerances. `error_m` and `error_rad`
    are the true errors. `planned` (N, 3) is the first path, `truth` (T, 3) the path driven, `estimate` (T, 3) the
    estimated poses, all in map. `times_s` (T,), `volts` (T, 2) of the forward and turn lines (neutral for a released
    line), `commands` (T, 2) [m/s, rad/s], `clearance` (T,) [m] from the footprint to the nearest wall.
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
        """The distance driven [m]."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())

    @property
    def duration_s(self) -> float:
        """The time from the goal's request to the end [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def localisation_error_m(self) -> float:
        """The root mean square error of the estimated position [m]."""
        return float(np.sqrt((np.hypot(*(self.truth - self.estimate)[:, :2].T) ** 2).mean()))


@dataclass(frozen=True, slots=True)
class DriveSetup:
    """The setting of a drive: the chair's map with its places, the chair, and `map_from_world` of the true poses.

    `stops` None: measured on the simulated chair (a chair without measured stops crawls). `zones` are the map's.
    `scanned` is the map as the lidar sees it, if it differs from `grid`. `cells`: the network of behaviour cells, if the chair has any.
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
    cells: str = "default"


def drive_to_places(
    setup: DriveSetup,
    simulator: Simulator,
    goals: Sequence[str],
    time_limit_s: float = 300.0,
    progress: Callable[[str, float], None] = lambda goal, metres: None,
    box: Path | None = None,
    trace: Path | None = None,
) -> tuple[DriveRecord, ...]:
    """Drive to the named places in turn, for at most `time_limit_s` of simulated time each.

    `progress` is called after each tick with the place and the way [m] driven to it.
    `box`: folder of a black box that logs the drive, for `waychair why`. `trace`: file for the trace of the chair's
    behaviour cells, if it has them (`ChairSettings.perceive`).

    Raises:
        BoxError: the black box cannot be written, or another program writes it.
        OutputError: the trace cannot be written.
        UnknownPlace: a goal is not among the places.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    legs = []
    with (
        black_box(setup, box) as log,
        nullcontext() if trace is None else CellTraceFile(trace) as cells,
        simulated_chair(setup, simulator, Watchers(log, cells)) as chair,
    ):
        for goal in goals:
            way = DrivenWay(simulator, partial(progress, goal))
            legs.append(drive_to_place(setup, simulator, chair, goal, time_limit_s, lambda *_, way=way: way.step()))
    return tuple(legs)


class DrivenWay:
    """Tells after each tick how far [m] a simulated chair has driven."""

    def __init__(self, simulator: SimulatedChair, tell: Callable[[float], None]) -> None:
        self._simulator, self._tell = simulator, tell
        self._last, self._metres = simulator.truth(), 0.0

    def step(self) -> None:
        """Add the way of the tick that has ended, and tell the sum."""
        pose = self._simulator.truth()
        self._metres, self._last = self._metres + math.dist((pose.x, pose.y), (self._last.x, self._last.y)), pose
        self._tell(self._metres)


def black_box(setup: DriveSetup, folder: Path | None) -> AbstractContextManager[BlackBox | None]:
    """Return the black box of the setting's chair, or a null context without a folder."""
    if folder is None:
        return nullcontext()
    return BlackBox(folder, LoggedChair(setup.chair, calibration_of(setup), setup.places))


@contextmanager
def simulated_chair(
    setup: DriveSetup,
    simulator: SimulatedChair,
    watcher: ChairWatcher | None = None,
    wrap_transport: Callable[[Transport], Transport] = lambda transport: transport,
    start_known: bool = True,
    haptics: HapticGuide | None = None,
) -> Iterator[Chair]:
    """Yield a chair at the simulated chair's place, connected to a board that drives the simulator during the block.

    Objects from before the block are left out of garbage collection within it, as in the nodes of a real chair.
    `watcher`, `haptics`: see `Chair`. `wrap_transport` may wrap the cable's transport. The chair is `start_known` its start pose or has to
    relocalise.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    start = setup.map_from_world @ simulator.truth()
    with HostBoard(board_program(), board_settings(setup)) as board:
        simulator.wire(board)
        cable = Reconnecting(lambda: wrap_transport(board.transport))
        try:
            chair = Chair(
                grid=setup.grid,
                places=setup.places,
                calibration=calibration_of(setup),
                cable=cable,
                start=start if start_known else None,
                settings=setup.chair,
                model=setup.calibration,
                zones=setup.zones,
                scanned=setup.scanned,
                watcher=watcher,
                haptics=haptics,
                cells=setup.cells,
            )
            with present_left_out():
                yield chair
        finally:
            simulator.wire(None)


def calibration_of(setup: DriveSetup) -> ChairCalibration:
    """Return the content of the chair's calibration file."""
    return simulated_calibration(setup.body, setup.stops)


def start_drive(simulator: Simulator, chair: Chair, goal: Goal) -> None:
    """Wait at most `READY_S` until the chair is ready, then request and confirm a goal; an unready chair drops it."""
    for _ in range(round(READY_S * COMMAND.rate_hz)):
        if chair.ready:
            break
        messages = advance_tick(simulator, chair)  # before the step, else the chair's clock is a tick late
        look_round(simulator, chair, chair.step(simulator.now_ns, messages))
    chair.go(goal)
    chair.confirm()


def hold_until_armed(simulator: Simulator, chair: Chair) -> None:
    """Hold a confirmed drive at a pause until the board is armed, at most `ARMED_S`, then let it go on.

    A board arms only for a drive, after two seconds with the stick at rest. An unready chair has no drive to hold.
    """
    for _ in range(round(ARMED_S * COMMAND.rate_hz)):
        messages = advance_tick(simulator, chair)
        look_round(simulator, chair, chair.step(simulator.now_ns, messages))
        if chair.bridge.armed or not chair.pause():
            break
    chair.go_on()


def board_settings(setup: DriveSetup) -> BoardSettings:
    """Return the board's settings for a chair: name, joystick family, converter, and the rider's override."""
    supervisor = setup.chair.supervisor
    return BoardSettings(
        chair_id=setup.body.chair_id,
        family=setup.chair.bridge.family or USUAL_FAMILY,
        dac_bits=max(8, setup.calibration.counts_max.bit_length()),
        neutral_per_mille=round(1000 * supervisor.at_rest),
        override_per_mille=round(1000 * supervisor.override),
        override_ms=supervisor.override_ms,
    )


def advance_tick(simulator: Simulator, chair: Chair) -> tuple[SensorMessage, ...]:
    """Advance the simulator by one tick with heartbeats to the board, and return the tick's messages."""
    messages: list[SensorMessage] = []
    for _ in range(TICK_NS // BEAT_NS):
        chair.beat(simulator.now_ns)
        messages += simulator.advance(BEAT_NS)
    return tuple(messages)


def look_round(simulator: Simulator, chair: Chair, state: ChairState) -> tuple[ServoMessage, ...]:
    """Let the camera on servos obey the cells after a tick, pass on its newest messages for the next one, and return them.

    Nothing happens without such a camera.
    """
    looked = simulator.look()
    chair.watch(looked)
    order = None if state.perceived is None else state.perceived.order
    if order is not None:
        simulator.aim(order)
    return looked


@dataclass(frozen=True, slots=True)
class SelfLocalisation:
    """Whether the chair localised itself, and how long [s] and far [m] the rider drove until then."""

    found: bool
    seconds: float
    metres: float


def localise_by_joystick(
    simulator: Simulator, chair: Chair, follower: Follower, on_tick: TickCallback = lambda messages, state: None
) -> SelfLocalisation:
    """Let a rider drive along a route by joystick until the chair has localised itself, then stop.

    Raises:
        WorldError: the chair touched something, or made no progress for a minute.
    """
    began_ns, metres, last = simulator.now_ns, 0.0, simulator.truth()
    progress = StallCheck(simulator)
    while True:
        messages = advance_tick(simulator, chair)
        state = chair.step(simulator.now_ns, messages)
        on_tick(messages, state)
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
        on_tick(messages, chair.step(simulator.now_ns, messages))
    return SelfLocalisation(found, seconds, metres)


def drive_to_place(
    setup: DriveSetup,
    simulator: Simulator,
    chair: Chair,
    goal: str,
    time_limit_s: float = 300.0,
    on_tick: TickCallback = lambda messages, state: None,
    armed: bool = False,
) -> DriveRecord:
    """Drive to one named place; see `drive_to_places`.

    The record begins with the request, or with `armed` once the board is armed; until then the drive is held at a pause.
    """
    start_drive(simulator, chair, Goal(goal))
    if armed:
        hold_until_armed(simulator, chair)
    began_ns, contacts = simulator.now_ns, simulator.contacts
    states: list[ChairState] = []
    truth, clearance, ticks, planned = [], [], [], np.empty((0, 3))
    while simulator.now_ns - began_ns < time_limit_s * 1e9:
        messages = advance_tick(simulator, chair)
        started = time.perf_counter()
        state = chair.step(simulator.now_ns, messages)
        ticks.append(1e3 * (time.perf_counter() - started))
        look_round(simulator, chair, state)
        on_tick(messages, state)
        states.append(state)
        truth.append((setup.map_from_world @ simulator.truth()).array())
        clearance.append(simulator.clearance())
        if not len(planned) and state.navigation.path is not None:
            planned = state.navigation.path.poses
        if state.navigation.stage in (Stage.ARRIVED, Stage.FAILED):
            break
    place, last = setup.places[goal], states[-1]
    error_m = math.hypot(truth[-1][0] - place.pose.x, truth[-1][1] - place.pose.y)
    error_rad = abs(wrap_angle(truth[-1][2] - place.pose.theta))
    arrived = last.navigation.stage is Stage.ARRIVED
    ended = last.navigation.stage in (Stage.ARRIVED, Stage.FAILED)
    reason = last.navigation.reason if ended else last.verdict.reason or "the time limit was reached"
    return DriveRecord(
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
