"""Whole drives of a driver without sight, led by touch: the simulated chair, its board's C and the glove's C in the loop.

The chair leads by its own software (`runtime.haptics`): it tells the driver's next movement, the glove's program plays it, the
driver feels the motors and moves the stick, and the stick reaches the chair's lines through the board. At the levels guard and
guide the board holds it within the chair's caps (state GUARD). Simulated drivers are not blind drivers.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.learning import RiderValues, rider_from_values
from waychair.control.haptics.next_door import DoorSide, door_words, no_door
from waychair.control.haptics.patterns import TouchVocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.rider import RiderModel
from waychair.errors import ConfigError, MissingExtra, PlanningError
from waychair.maps.drawn.zones import Zone
from waychair.planning.grid.costmap import LiveCostmap
from waychair.planning.steps.step import StepPlan
from waychair.planning.steps.step_planner import StepPlanner
from waychair.runtime.chair import ChairSettings, ChairState
from waychair.runtime.haptics.haptic_guide import HapticGuide
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.simulation.follower import Follower
from waychair.simulation.plan.world import World
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.rider.blind_driver import Felt
from waychair.simulation.rider.lone_driver import LoneDriver
from waychair.simulation.scene.contact import Contact
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DrivenWay, DriveSetup, simulated_chair
from waychair.trials.guiding.helped_chair import HelpedChair
from waychair.trials.guiding.live_haptics import HapticOptions, haptics_of
from waychair.trials.guiding.paper_chair import paper_body, paper_sensors
from waychair.trials.guiding.sound_track import SoundTrack
from waychair.trials.ride import RecordingSimulator
from waychair.types import FloatArray, Goal, HelpLevel, JoystickInput, OccupancyGrid, Place, Pose2

UNCAPPED = (1.0, 1.0, 1.0, 1.0)
"""Caps of a stick that the board does not guard."""


NO_GUARD = "the paper's sensors do not show enough for the board to guard the stick: choose the level inform"
"""Reason for which a chair with the paper's sensors alone has no level but inform."""


class RiderTold(enum.Enum):
    """The channel to a rider: the chair's symbols on the glove; for comparison the paper's signals on it, none, or the sight of
    the same steps."""

    GUIDED = "guided"
    PAPER = "paper"
    NOTHING = "nothing"
    SEES = "sees"


class GuidedSensors(enum.Enum):
    """The chair's sensors: the usual ones, by which it may also look for doorways; or the paper's alone, with the paper's network."""

    USUAL = "usual"
    WITH_DOORWAYS = "with doorways"
    PAPER = "paper"


@dataclass(frozen=True, slots=True)
class GuidedSetup:
    """The setting of guided drives: the map, its zones, the chair, the driver, the level, and the device on the skin.

    `driver` is a preset's name. `known` was learnt of the driver before; the drives add to it. A goal is reached within `near_m`.
    `words`: other patterns than the shipped ones. `track`: speech and tones as well, which it takes in.
    """

    world: World
    grid: OccupancyGrid
    body: ChairBody
    driver: str = "default"
    level: HelpLevel = HelpLevel.GUIDE
    layout: str = "glove_3x3"
    seed: int = 0
    zones: tuple[Zone, ...] = ()
    known: RiderValues = field(default_factory=dict)
    told: RiderTold = RiderTold.GUIDED
    words: TouchVocabulary | None = None
    near_m: float = 0.5
    sensors: GuidedSensors = GuidedSensors.USUAL
    simulator: SimulatorSettings | None = None
    track: SoundTrack | None = None


@dataclass(frozen=True, slots=True)
class SaidSymbol:
    """A symbol that was sent to the glove, and why."""

    stamp_ns: int
    symbol: str
    reason: str


@dataclass(frozen=True, slots=True)
class GuidedRecord:
    """One guided drive. `reached`: the guide said so, and the chair truly stood within the setting's `near_m` of the goal; of a
    drive that nobody led, the chair was where it was to be.

    `truth` (T, 3) in map, `times_s` (T,), `caps` (T, 4) of the board to the front, the rear, the left and the right, `stick`
    (T, 2) as the driver pushed. `remembered` was learnt of the driver, before and in the drive.
    `planned_m` is the length of the first steps. `told`, `felt`: symbols. `announced`: sentences besides the symbols, such as why
    the rider has to wait.
    """

    goal: Place
    reached: bool
    reason: str
    seconds: float
    contacts: tuple[Contact, ...]
    planned_m: float
    plans: int
    told: tuple[SaidSymbol, ...]
    felt: tuple[Felt, ...]
    announced: tuple[str, ...]
    times_s: FloatArray
    truth: FloatArray
    caps: FloatArray
    stick: FloatArray
    remembered: RiderValues

    @property
    def learnt(self) -> RiderModel:
        """What is known of the driver after the drive."""
        return rider_from_values(self.remembered)

    @property
    def distance_m(self) -> float:
        """Distance driven [m]."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum()) if len(self.truth) > 1 else 0.0

    @property
    def error_m(self) -> float:
        """Distance [m] from the goal at the end."""
        return math.hypot(self.truth[-1, 0] - self.goal.pose.x, self.truth[-1, 1] - self.goal.pose.y)


def guided_drive(
    setup: GuidedSetup,
    goal: Place | DoorSide,
    time_limit_s: float = 180.0,
    progress: Callable[[float], None] = lambda metres: None,
) -> GuidedRecord:
    """Drive once to a place, or through the next door on a side; raises as `guided_trial`.

    A chair with the paper's sensors is told where the place lies, as it has no map. `progress` is called after each tick with the way
    driven [m].
    """
    with guided_trial(setup, progress) as trial:
        if isinstance(goal, DoorSide):
            return trial.find_and_drive_through(goal, time_limit_s)
        by_odometry = setup.sensors is GuidedSensors.PAPER
        return trial.drive_by_odometry(goal, time_limit_s) if by_odometry else trial.drive_to(goal, time_limit_s)


@contextmanager
def guided_trial(setup: GuidedSetup, progress: Callable[[float], None] = lambda metres: None) -> Iterator[GuidedTrial]:
    """Yield the rider of a chair at the world's start, who has chosen the level of help.

    `progress` is called after each tick with the way driven [m].

    Raises:
        BoardBuildError: a firmware cannot be built: no C compiler.
        WorldError: the chair does not fit at the world's start.
        ConfigError: there is no such driver, or no guard by the sensors that the chair has.
        MissingExtra: this machine cannot render the pictures of the paper's camera.
    """
    settings, body, cells = setup.simulator or randomised_settings(setup.seed), setup.body, "default"
    if setup.sensors is GuidedSensors.PAPER:
        if setup.level is not HelpLevel.INFORM:
            raise ConfigError(NO_GUARD)
        settings, body, cells = paper_sensors(settings), paper_body(body), "paper"
    simulator = RecordingSimulator(setup.world, body, settings, setup.seed)
    if setup.sensors is GuidedSensors.PAPER and simulator.camera_problem is not None:
        raise MissingExtra(simulator.camera_problem)
    as_paper, has_glove = setup.told is RiderTold.PAPER, setup.told in (RiderTold.GUIDED, RiderTold.PAPER)
    chair_settings = ChairSettings(perceive=setup.sensors is not GuidedSensors.USUAL or as_paper)
    drive = DriveSetup(setup.grid, {}, body, DEFAULT, chair=chair_settings, zones=setup.zones, cells=cells)
    heard = setup.track is not None
    profile = HapticsProfile(layout=setup.layout, speech=heard, tones=heard, advice="paper" if as_paper else "guide")
    touch = HapticOptions(profile, driver=setup.driver, words=setup.words, track=setup.track)
    with (
        haptics_of(touch if has_glove else None, drive, setup.seed, apart=False) as parts,
        simulated_chair(drive, simulator, haptics=parts.guide) as chair,
    ):
        if parts.guide is not None:
            parts.guide.leader.learner.restore(setup.known, {})
        trial = GuidedTrial(setup, simulator, HelpedChair(simulator, chair, parts), DrivenWay(simulator, progress))
        trial.begin()
        yield trial


class GuidedTrial:
    """A rider who is led from place to place; the drives follow each other on one chair, with one glove."""

    def __init__(self, setup: GuidedSetup, simulator: RecordingSimulator, helped: HelpedChair, way: DrivenWay) -> None:
        self.simulator, self.chair = simulator, helped.chair
        self._way = way
        self._setup, self._helped = setup, helped
        self._guide = helped.parts.guide
        self._follower: Follower | None = None
        self._there: Callable[[Pose2], bool] | None = None
        self._lone = LoneDriver(seed=setup.seed) if setup.told is RiderTold.NOTHING else None
        self._count = 0
        self._told: list[SaidSymbol] = []
        self._announced: list[str] = []
        self._rows: list[tuple[float, ...]] = []
        self._plans: list[StepPlan] = []

    def begin(self) -> None:
        """Wait until the chair helps at the chosen level."""
        for _, state in self._helped.begin(self._setup.level):
            self._note(state)

    def drive_to(self, goal: Place, time_limit_s: float) -> GuidedRecord:
        """Be led to a place until the arrival, the limit, or until no steps lead on.

        At the level guard nobody says anything, and a driver without sight stands.
        """
        return self._drive(goal, time_limit_s, lambda: self._ask(goal))

    def drive_by_odometry(self, goal: Place, time_limit_s: float) -> GuidedRecord:
        """Be led to a place without the map, which is told where it lies from the chair."""
        odom_from_map = self._map_from_odom().inverse()

        def ask() -> str:
            self._led.lead_by_odometry(replace(goal, pose=odom_from_map @ goal.pose))
            return ""

        return self._drive(goal, time_limit_s, ask)

    def go_nearer(self) -> GuidedRecord:
        """Be led straight on a little without the map: a doorway is not found from one place."""
        on = Place("on", self.simulator.truth() @ Pose2(NEARER), 0.5, math.pi)
        return self.drive_by_odometry(on, NEARER_S)

    def drive_through(self, side: DoorSide, time_limit_s: float) -> GuidedRecord:
        """Be led through the next doorway that the chair sees on a side, without the map."""
        done, told = self.chair.lead_through(side)
        goal = self._led.leader.goal if done else None
        if goal is None:
            return self._drive(Place(door_words(side), self.simulator.truth()), time_limit_s, lambda: told)
        return self._drive(replace(goal, pose=self._map_from_odom() @ goal.pose), time_limit_s, lambda: "")

    def find_and_drive_through(self, side: DoorSide, time_limit_s: float) -> GuidedRecord:
        """Go on a little, and be led through the next doorway on a side; where none is seen yet, go on again, a few times."""
        for _ in range(NEARER_TIMES):
            self.go_nearer()
            record = self.drive_through(side, time_limit_s)
            if record.reason != no_door(side):
                break
        return record

    def drive_unled(self, time_limit_s: float, there: Callable[[Pose2], bool]) -> GuidedRecord:
        """Let a driver whom nobody leads to a place try, until the chair truly is `there`."""
        return self._drive(Place("there", self.simulator.truth()), time_limit_s, lambda: "", there)

    @property
    def _led(self) -> HapticGuide:
        assert self._guide is not None  # a driver without sight has one
        return self._guide

    def _map_from_odom(self) -> Pose2:
        return self.simulator.truth() @ self.chair.odom_from_base.inverse()

    def _drive(
        self,
        goal: Place,
        time_limit_s: float,
        ask: Callable[[], str],
        there: Callable[[Pose2], bool] | None = None,
    ) -> GuidedRecord:
        simulator, setup = self.simulator, self._setup
        self._there = there
        began_ns, contacts = simulator.now_ns, simulator.contacts
        driver = self._helped.parts.driver
        felt = 0 if driver is None else len(driver.felt)
        self._rows, self._told, self._announced, self._plans = [], [], [], []
        arrived, reason = False, ask()
        while not reason and simulator.now_ns - began_ns < time_limit_s * 1e9:
            arrived, reason = self._ended(self._tick())
        if self._guide is not None and self._guide.leader.goal is not None:
            self._guide.end("the drive has ended")
        rows = np.array(self._rows or [self._row()])
        record = GuidedRecord(
            goal=goal,
            reached=arrived,
            reason=reason or "the time limit was reached",
            seconds=(simulator.now_ns - began_ns) * 1e-9,
            contacts=tuple(simulator.contact_reports[contacts:]),
            planned_m=self._plans[0].length if self._plans else 0.0,
            plans=len(self._plans),
            told=tuple(self._told),
            felt=() if driver is None else tuple(driver.felt[felt:]),
            announced=tuple(self._announced),
            times_s=rows[:, 0],
            truth=rows[:, 1:4],
            caps=rows[:, 4:8],
            stick=rows[:, 8:10],
            remembered={} if self._guide is None else self._guide.leader.learner.values(),
        )
        return replace(record, reached=arrived and (there is not None or record.error_m <= setup.near_m))

    def _ask(self, goal: Place) -> str:
        """Ask to be led; a rider who sees looks at the steps once. Return why not; empty if all is well."""
        setup = self._setup
        if setup.told is not RiderTold.SEES:
            if setup.level is not HelpLevel.GUARD:
                self.chair.lead(goal)
            return ""
        ground, pose = LiveCostmap(setup.grid, setup.body, setup.zones), self._tick().map_from_base
        try:
            plan = StepPlanner(Goal(goal.pose), goal.pose).replan(ground.costmap(), pose)
        except PlanningError as error:
            return str(error)
        self._plans.append(plan)
        route = np.array([[step.end.x, step.end.y] for step in plan.steps if step.length > 0.0]).reshape(-1, 2)
        self._follower = Follower(route, setup.body.track, PlantSettings())
        return ""

    def _ended(self, state: ChairState) -> tuple[bool, str]:
        """Return whether the rider has arrived, and why the drive has ended; empty while it goes on."""
        if self.chair.level is not self._setup.level:
            return False, self.chair.level_told
        if self._there is not None:
            arrived = self._there(self.simulator.truth())
            return arrived, "there" if arrived else ""
        if self._follower is not None:
            arrived = self._follower.done and abs(state.twist.v) < _STANDS
            return arrived, "arrived" if arrived else ""
        if self._guide is None or self._setup.level is HelpLevel.GUARD:
            return False, ""
        leader = self._guide.leader
        return leader.arrived, leader.reason if leader.goal is None else ""

    def _tick(self) -> ChairState:
        _, state = self._helped.tick()
        if self._lone is not None and self._there is not None:
            self.simulator.rider = self._lone.step(self.simulator.now_ns, self.simulator.twist())
        if self._setup.told is RiderTold.SEES:
            self.simulator.rider = self._seen_stick()
        self._note(state)
        self._way.step()
        return state

    def _seen_stick(self) -> JoystickInput:
        """Return the stick of the rider who sees."""
        simulator, follower = self.simulator, self._follower
        if follower is None:
            return JoystickInput(simulator.now_ns)
        forward, turn = follower.stick(simulator.truth(), simulator.body, simulator.people)
        return JoystickInput(simulator.now_ns, forward, turn)

    def _note(self, state: ChairState) -> None:
        """Note a tick: where the chair is, the caps and the stick, new steps, and what was said."""
        self._rows.append(self._row())
        plan = None if self._guide is None else self._guide.leader.plan
        if plan is not None and plan not in self._plans[-1:]:
            self._plans.append(plan)
        said = state.haptics or HapticState(0)
        if said.count > self._count and said.symbol and not said.unfelt:
            self._told.append(SaidSymbol(state.stamp_ns, said.symbol, said.reason))
        elif said.count > self._count and not said.symbol:
            self._announced.append(said.text)
        self._count = said.count

    def _row(self) -> tuple[float, ...]:
        simulator, telemetry = self.simulator, self.chair.bridge.telemetry
        guard = None if telemetry is None else telemetry.guard
        pose, stick = simulator.truth(), simulator.rider
        caps = UNCAPPED if guard is None else guard.caps
        return simulator.now_ns * 1e-9, pose.x, pose.y, pose.theta, *caps, stick.forward, stick.turn


NEARER, NEARER_S, NEARER_TIMES = 0.7, 40.0, 3
"""m that a driver first goes on towards a door that is to be found, s for it at most, and how often."""

_STANDS = 0.02
"""m/s; a slower chair stands."""
