"""Whole drives of a driver who cannot see, led by touch: the simulated chair, its board's C and the glove's C in the loop.

Every tick: the sensors' messages go to the chair's software, the guide says what the driver should do, the glove's program
plays it, the driver feels the motors and moves the stick, and the stick reaches the chair's lines through the board. At
the levels guard and guide the board holds it within the chair's caps (state GUARD). Simulated drivers are not blind drivers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.advice import AdviceMemory, advise, valid_ms
from waychair.control.haptics.guidance import Guidance, GuideInputs, GuideState
from waychair.control.haptics.guide import Guide
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.patterns import Vocabulary, vocabulary
from waychair.control.haptics.rider import RiderModel
from waychair.control.haptics.symbols import PRIORITY, Symbol
from waychair.control.safety.guard import GUARDED
from waychair.errors import PlanningError
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.fitting import Fitting
from waychair.firmware_bridge.glove.program import GloveConfig, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting
from waychair.maps.drawn.zones import Zone
from waychair.planning.grid.costmap import Costmap, LiveCostmap
from waychair.planning.steps.step import StepPlan
from waychair.planning.steps.step_planner import StepPlanner
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.runtime.haptics.live_ground import with_new
from waychair.simulation.follower import Follower
from waychair.simulation.plan.world import World
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.rider.blind_driver import BlindDriver, DriverModel, Felt
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.demo import randomised_settings
from waychair.trials.drive import ARMED_S, READY_S, TICK_NS, DriveSetup, advance_tick, simulated_chair
from waychair.types import FloatArray, Goal, HelpLevel, JoystickInput, OccupancyGrid, Place, Scan, SensorMessage

UNCAPPED = (1.0, 1.0, 1.0, 1.0)
"""Caps of a stick that the board does not guard."""

REPLANS = 8
"""Plans of one drive after the first, after which the drive ends."""


@dataclass(frozen=True, slots=True)
class GuidedSetup:
    """A guided drive: the map, its zones, the goal, the chair, the driver, the level, and the device on the skin.

    `known` is known of the driver before; with `learn` the drive adds to it. With `sees` a rider who sees steers along the same
    steps instead, for comparison.
    """

    world: World
    grid: OccupancyGrid
    goal: Place
    body: ChairBody
    driver: DriverModel = field(default_factory=DriverModel)
    level: HelpLevel = HelpLevel.GUIDE
    layout: str = "glove_3x3"
    seed: int = 0
    zones: tuple[Zone, ...] = ()
    known: RiderModel = field(default_factory=RiderModel)
    learn: bool = True
    sees: bool = False
    near_m: float = 0.5
    simulator: SimulatorSettings | None = None


@dataclass(frozen=True, slots=True)
class SaidSymbol:
    """A symbol that was sent to the glove, and why."""

    stamp_ns: int
    symbol: str
    reason: str


@dataclass(frozen=True, slots=True)
class GuidedRecord:
    """One guided drive. `reached`: the guide said so, and the chair truly stood within `near_m` of the goal.

    `truth` (T, 3) in map, `times_s` (T,), `caps` (T, 4) of the board to the front, the rear, the left and the right, `stick`
    (T, 2) as the driver pushed.
    `contact_speeds` [m/s] of the contacts; `planned_m` is the length of the first steps. `told`, `felt`: symbols.
    """

    reached: bool
    reason: str
    seconds: float
    error_m: float
    contact_speeds: tuple[float, ...]
    planned_m: float
    plans: int
    told: tuple[SaidSymbol, ...]
    felt: tuple[Felt, ...]
    times_s: FloatArray
    truth: FloatArray
    caps: FloatArray
    stick: FloatArray
    learnt: RiderModel

    @property
    def distance_m(self) -> float:
        """Distance driven [m]."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum()) if len(self.truth) > 1 else 0.0


def guided_drive(setup: GuidedSetup, time_limit_s: float = 180.0) -> GuidedRecord:
    """Drive once to the goal.

    Raises:
        BoardBuildError: a firmware cannot be built: no C compiler.
        WorldError: the chair does not fit at the world's start.
        NoSteps, PlanningError: no steps lead to the goal from the start.
    """
    simulator = Simulator(setup.world, setup.body, setup.simulator or randomised_settings(setup.seed), setup.seed)
    drive = DriveSetup(
        grid=setup.grid,
        places={setup.goal.name: setup.goal},
        body=setup.body,
        calibration=DEFAULT,
        chair=ChairSettings(),
        zones=setup.zones,
    )
    glove = HostGlove(glove_program(), GloveConfig(layout=setup.layout))
    with simulated_chair(drive, simulator) as chair, glove:
        trial = _Trial(setup, simulator, chair, glove)
        trial.get_ready()
        return trial.run(time_limit_s)


def used_to(driver: DriverModel, plant: PlantSettings) -> DriverModel:
    """Return a driver who knows from which push on this chair begins to turn, and nudges by as much beyond it.

    An assumption: nobody is led by nudges before the hour with a trainer in which this is felt.
    """
    stiffer = (plant.turn_dead_band - PlantSettings().turn_dead_band) / plant.swing_volts
    return replace(driver, hand=replace(driver.hand, nudge=driver.hand.nudge + stiffer))


class _Hand:
    """Glove and driver: symbols in, the stick out."""

    def __init__(self, setup: GuidedSetup, glove: HostGlove, plant: PlantSettings) -> None:
        self.words: Vocabulary = vocabulary(setup.layout)
        learnt = {symbol.value: pattern.steps() for symbol, pattern in self.words.patterns.items()}
        learnt |= {f"obstacle {motor}": pattern.steps() for motor, pattern in self.words.obstacles.items()}
        self.driver = BlindDriver(self.words.layout, learnt, used_to(setup.driver, plant), setup.seed)
        self._glove = glove
        self._bridge = GloveBridge(Reconnecting(lambda: glove.transport), "A", self.words.layout, Fitting())
        self._memory = AdviceMemory()
        self.told: list[SaidSymbol] = []

    @property
    def durations(self) -> dict[Symbol, float]:
        """Durations of the patterns [s]."""
        return {symbol: 1e-3 * pattern.duration_ms for symbol, pattern in self.words.patterns.items()}

    def say(self, guidance: Guidance, now_ns: int) -> bool:
        """Pass advice on to the glove; return whether it is played."""
        wanted = [guidance.advice] if guidance.advice is not None else []
        advised, self._memory = advise(wanted, self.words, self._memory, now_ns)
        if advised.stop:
            self._bridge.stop()
        if advised.say is None:
            return False
        said = advised.say
        steps = self.words.pattern(said).steps()
        refused = self._bridge.play(steps, PRIORITY[said.symbol], valid_ms(said, now_ns), now_ns)
        if refused:
            return False
        self.told.append(SaidSymbol(now_ns, said.symbol.value, said.reason))
        return True

    def stick(self, now_ns: int) -> JoystickInput:
        """Let the glove's program run up to now, and return the driver's stick."""
        self._bridge.tick(now_ns, armed=True)
        return self.driver.step(now_ns, self._glove.step(now_ns // 1_000_000))


class _Trial:
    """One drive under way."""

    def __init__(self, setup: GuidedSetup, simulator: Simulator, chair: Chair, glove: HostGlove) -> None:
        self._setup, self._simulator, self._chair = setup, simulator, chair
        self._hand = _Hand(setup, glove, simulator.settings.plant)
        self._live = LiveCostmap(setup.grid, setup.body, setup.zones)
        self._planner = StepPlanner(Goal(setup.goal.pose), setup.goal.pose)
        self._learner = RiderLearner(setup.known)
        self._scan: Scan | None = None
        self._stick = JoystickInput(0)
        self._caps = UNCAPPED
        self._rows: list[tuple[float, ...]] = []
        self._plans = 0
        self._follower: Follower | None = None

    def get_ready(self) -> None:
        """Let the chair find its board, lidar and pose, and the glove its computer; then begin the level of help."""
        for _ in range(round(READY_S / TICK_NS * 1e9)):
            state = self._tick()
            if self._chair.ready and state.localisation is not None and self._scan is not None:
                break
        self._chair.choose_level(self._setup.level)
        if self._setup.level in GUARDED:
            for _ in range(round(ARMED_S / TICK_NS * 1e9)):
                board = self._tick().telemetry
                if board is not None and board.guard is not None:
                    break

    def run(self, time_limit_s: float) -> GuidedRecord:
        """Drive until the arrival, the limit, or until no steps lead on."""
        simulator, setup = self._simulator, self._setup
        began_ns, contacts = simulator.now_ns, simulator.contacts
        state = self._tick()
        plan = self._replan(state)
        planned_m, memory, reason, arrived = plan.length, GuideState(), "the time limit was reached", False
        while simulator.now_ns - began_ns < time_limit_s * 1e9:
            state = self._tick()
            if self._chair.level is not setup.level:
                reason = self._chair.level_told
                break
            if setup.level is HelpLevel.GUARD:
                continue  # caps alone: nobody says anything
            if setup.sees:
                if self._follower is not None and self._follower.done and abs(state.twist.v) < _STANDS:
                    arrived, reason = True, "arrived"
                    break
                continue
            guidance, memory = self._guide(plan, memory, state)
            if guidance.arrived:
                arrived, reason = True, "arrived"
                break
            if guidance.astray:
                if self._plans > REPLANS:
                    reason = guidance.reason
                    break
                try:
                    plan = self._replan(state)
                    memory = GuideState(number=memory.number, said=memory.said, said_ns=memory.said_ns)
                except PlanningError as error:
                    reason = str(error)  # no steps lead on from here; the old ones may, from a little elsewhere
                    memory = replace(memory, tries=0, shuffles=0)
        truth = np.array([row[1:4] for row in self._rows])
        error_m = math.hypot(truth[-1, 0] - setup.goal.pose.x, truth[-1, 1] - setup.goal.pose.y)
        rows = np.array(self._rows)
        return GuidedRecord(
            reached=arrived and error_m <= setup.near_m,
            reason=reason,
            seconds=(simulator.now_ns - began_ns) * 1e-9,
            error_m=error_m,
            contact_speeds=tuple(contact.speed for contact in simulator.contact_reports[contacts:]),
            planned_m=planned_m,
            plans=self._plans,
            told=tuple(self._hand.told),
            felt=tuple(self._hand.driver.felt),
            times_s=rows[:, 0],
            truth=truth,
            caps=rows[:, 4:8],
            stick=rows[:, 8:10],
            learnt=self._learner.model,
        )

    def _tick(self) -> ChairState:
        """Let a tick pass: sensors, software, glove, driver, stick."""
        simulator = self._simulator
        messages = advance_tick(simulator, self._chair)
        state = self._chair.step(simulator.now_ns, messages)
        self._hear(messages)
        stick = self._hand.stick(simulator.now_ns)
        self._stick = simulator.rider = self._seen_stick() if self._setup.sees else stick
        guard = None if state.telemetry is None else state.telemetry.guard
        self._caps = UNCAPPED if guard is None else guard.caps
        pose = simulator.truth()
        row = simulator.now_ns * 1e-9, pose.x, pose.y, pose.theta, *self._caps, self._stick.forward, self._stick.turn
        self._rows.append(row)
        return state

    def _seen_stick(self) -> JoystickInput:
        """Return the stick of the rider who sees."""
        simulator, follower = self._simulator, self._follower
        if follower is None:
            return JoystickInput(simulator.now_ns)
        forward, turn = follower.stick(simulator.truth(), simulator.body, simulator.people)
        return JoystickInput(simulator.now_ns, forward, turn)

    def _hear(self, messages: tuple[SensorMessage, ...]) -> None:
        for message in messages:
            if isinstance(message, Scan):
                self._scan = message

    def _guide(self, plan: StepPlan, memory: GuideState, state: ChairState) -> tuple[Guidance, GuideState]:
        """Ask the guide, say its word, and learn from the rider's motion."""
        now_ns, stick = self._simulator.now_ns, self._stick
        if self._setup.learn:
            self._learner.note_motion(now_ns, state.twist)
        guide = Guide(self._setup.body, self._learner.model, self._hand.durations)
        inputs = GuideInputs.under(self._caps, stick.forward, stick.turn, now_ns, state.map_from_base, state.twist)
        guidance, after = guide.step(plan, memory, inputs)
        if self._hand.say(guidance, now_ns):
            said = self._hand.told[-1].symbol
            self._learner.note_said(Symbol(said), now_ns, self._hand.durations[Symbol(said)], state.twist)
        elif guidance.advice is not None:  # it was not said, so nobody will obey
            after = replace(after, said=memory.said, said_ns=memory.said_ns, nudges=memory.nudges)
        self._chair.slow_ahead(guidance.cap, now_ns)
        return guidance, after

    def _replan(self, state: ChairState) -> StepPlan:
        self._plans += 1
        plan = self._planner.replan(self._costmap(state), state.map_from_base)
        route = np.array([[step.end.x, step.end.y] for step in plan.steps if step.length > 0.0]).reshape(-1, 2)
        self._follower = Follower(route, self._setup.body.track, PlantSettings())
        return plan

    def _costmap(self, state: ChairState) -> Costmap:
        """Return the costmap with everything in the latest scan that is not on the map."""
        if self._scan is None or self._plans == 1:
            return self._live.costmap()
        return with_new(
            self._live, self._scan, self._setup.body, state.map_from_base, state.twist, self._simulator.now_ns
        )


_STANDS = 0.02
"""m/s; a slower chair stands."""
