"""Whole chairs that share a building: they ask the warden for their ways and drive by its grants, in lockstep.

Every chair runs the real software with the shipped firmware at the end of its cable. The order is kept ten times a second by
one warden in the same process, which hears every report at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.authority import crosses
from waychair.control.drive.navigation import ACTIVE, Stage
from waychair.control.safety.stops import halt_as_told
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.order import Order, Request, parked
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Audit, Wait
from waychair.planning.fleet.warden import Heard, WardenState, decided
from waychair.planning.fleet.ways import Ways, ways_of
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.runtime.fleet.chain_driving import ChainDriver, Steps
from waychair.runtime.fleet.chain_geometry import drivable
from waychair.runtime.fleet.shut_ways import ShutWays
from waychair.simulation.fleet import ChairPlan, FleetSimulator
from waychair.simulation.plan.world import World
from waychair.simulation.scene.seeds import chair_seed
from waychair.simulation.simulated_chair import SimulatedChair
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import BEAT_NS, TICK_NS, DriveSetup, simulated_chair
from waychair.types import FloatArray, Goal, OccupancyGrid, Place, Pose2, SensorMessage

SPEED = 0.45
"""m/s; mean speed of a chair from room to room, with its turns, by which the warden foresees times."""

CLEARING_MS = 3_000
"""ms that a chair takes to leave a spot with its whole length."""

STEPS_OF_ORDER = 2
"""Ticks of the chairs for each step of the order."""

LOCKED_UP_S = 300.0
"""s; no movement of any chair for so long, with goals left, is a lock-up."""

AGAIN_AFTER_S = 5.0
"""s; a rider whose drive ended before its goal asks again so much later."""

MOST_TRIES, TRIED_WITHIN = 5, 1.0
"""Times that a rider asks again while no drive gets the chair farther than so many metres."""

_MOVES = 0.02
"""m/s or rad/s; a slower chair stands."""

_SAME_LINE = 0.01
"""m; a stop line that has moved by no more is the same one."""


@dataclass(frozen=True, slots=True)
class FleetScene:
    """A world and its traffic graph; for each chair the refuge where it starts and its goals in turn.

    `places` are the poses of all refuges, for a body; `zones` are drawn on every chair's map. `hidden` is the world without
    the things that are on no map, if there are any.
    """

    world: World
    graph: TrafficGraph
    places: Mapping[str, Place]
    starts: tuple[str, ...]
    goals: tuple[tuple[str, ...], ...]
    body: ChairBody = CHAIR_A
    seed: int = 0
    time_limit_s: float = 1200.0
    zones: tuple[Zone, ...] = ()
    hidden: World | None = None

    @property
    def mapped(self) -> OccupancyGrid:
        """The map of all chairs."""
        return (self.hidden or self.world).grid


@dataclass(slots=True)
class ChairRun:
    """What one chair did: goals reached with the time [s] each took, seconds it stood for others, metres, its track.

    `track` has a row of time [s], x, y [m], heading [rad] for each step of the order. `over_line` [m] is the farthest that
    its foremost corner came beyond a stop line. `lines_across` lines were given to it where it already was, as a blocked way
    is given back: of them only the way from there on counts. `end_error` [m]: its true distance from its last goal when all
    were reached.
    """

    goals: int
    reached: int = 0
    took_s: list[float] = field(default_factory=list)
    waited_s: float = 0.0
    metres: float = 0.0
    again: int = 0
    over_line: float = 0.0
    lines_across: int = 0
    person_m: float = math.inf
    ends: list[str] = field(default_factory=list)
    track: list[tuple[float, float, float, float]] = field(default_factory=list)
    end_error: float | None = None
    _line: FloatArray | None = None
    _over_at_first: float = 0.0

    def note(self, now_s: float, chair: SimulatedChair, waits_s: float) -> None:
        """Take down where a chair is now, and that it has waited so long [s] for others since the last time."""
        self.note_pose(now_s, chair.truth(), chair.person_distance(), waits_s)

    def note_pose(self, now_s: float, pose: Pose2, person_m: float, waits_s: float) -> None:
        """Take down the chair's true pose, its distance [m] from the nearest person, and its waiting since the last time [s]."""
        if self.track:
            self.metres += math.dist(self.track[-1][1:3], (pose.x, pose.y))
        self.track.append((now_s, pose.x, pose.y, pose.theta))
        self.waited_s += waits_s
        self.person_m = min(self.person_m, person_m)

    def note_line(self, line: FloatArray | None, over: float) -> None:
        """Take down that a chair is so far [m] beyond its stop line."""
        if line is None or self._line is None or np.abs(line - self._line).max() > _SAME_LINE:
            self._line, self._over_at_first = line, over
            self.lines_across += over > _SAME_LINE
        self.over_line = max(self.over_line, over - self._over_at_first)

    def note_end(self, goal: Pose2, pose: Pose2) -> None:
        """Take down how far a chair is from its last goal, if it has reached all."""
        if self.reached == self.goals:
            self.end_error = math.dist((goal.x, goal.y), (pose.x, pose.y))


@dataclass(slots=True)
class FleetRun:
    """The result of a scene; contacts are those of chairs with chairs, people and things. `nearest` [m]: between chairs."""

    chairs: list[ChairRun]
    chair_contacts: int = 0
    person_contacts: int = 0
    solid_contacts: int = 0
    lockups: int = 0
    seconds: float = 0.0
    nearest: float = math.inf
    audit: Audit = field(default_factory=Audit)

    def count_contacts(self, simulator: FleetSimulator) -> None:
        """Take down all contacts that there were."""
        kinds = [contact.kind.value for chair in simulator.chairs for contact in chair.contact_reports]
        self.chair_contacts = len(simulator.chair_contacts)
        self.person_contacts = kinds.count("person")
        self.solid_contacts = len(kinds) - self.person_contacts

    @property
    def contacts(self) -> int:
        """All contacts."""
        return self.chair_contacts + self.person_contacts + self.solid_contacts

    @property
    def finished(self) -> bool:
        """Whether all goals were reached."""
        return all(chair.reached == chair.goals for chair in self.chairs)


@dataclass(frozen=True, slots=True)
class FleetMoment:
    """All chairs at one step of the order: true poses, their states, the stop lines, present waits and people (K, 2) [m]."""

    now_ns: int
    poses: tuple[Pose2, ...]
    states: tuple[ChairState, ...]
    lines: tuple[FloatArray | None, ...]
    waits: tuple[Wait, ...]
    people: FloatArray
    reached: tuple[int, ...]


Events = Callable[[FleetSimulator, Sequence[Chair], float], None]
"""A change of a scene under way: called before each tick with the simulator, the chairs and the time [s]."""


@dataclass(slots=True)
class _Again:
    """A rider's tries after drives that ended early: when the next one is due, how many there were, and where the first was."""

    due_ms: int | None = None
    tries: int = 0
    place: Pose2 = field(default_factory=Pose2)


class Rider:
    """One chair with its goals: asks the warden, drives, and asks again after a drive that ended before its goal."""

    def __init__(
        self,
        number: int,
        chair: Chair,
        setup: DriveSetup,
        driver: ChainDriver,
        goals: Sequence[str],
        run: ChairRun,
    ) -> None:
        self.number, self.chair, self.driver, self.run = number, chair, driver, run
        self._setup = setup
        self._barred: set[str] = set()
        self.state: ChairState | None = None
        self.held = False
        self.line: FloatArray | None = None
        self._goals = list(goals)
        self._asked_ms: int | None = None
        self._course: tuple[Goal, ...] = ()
        self._left = 0
        self._again = _Again()
        self._shut = ShutWays(driver)

    @property
    def done(self) -> bool:
        """Whether no goal is left."""
        return not self._goals

    def count_goals(self) -> int:
        """Return the goals of the present chain that are not reached yet."""
        stage = self.chair.navigator.stage
        if stage is Stage.ARRIVED:
            self._left = 0
        elif stage in ACTIVE and self.state is not None and self.state.navigation.goals:
            self._left = self.state.navigation.goals
        return self._left

    def wish(self, now_ms: int, numbers: Iterator[int]) -> Request | None:
        """Return the request for the next goal, if it has not been made."""
        if self._asked_ms is not None or not self._goals or not self.chair.ready:
            return None
        self._asked_ms = now_ms
        return Request(next(numbers), self.number, self._goals[0], now_ms, Priority.ROUTINE)

    def keep_on_chain(self, steps: Steps) -> None:
        """Close the ways round a new chain on this chair's own map."""
        if not steps.goals or {zone.name for zone in steps.bars} == self._barred:
            return
        self._barred = {zone.name for zone in steps.bars}
        zones = (*self._setup.zones, *steps.bars)
        drawn = self.chair.drawn(self._setup.grid, zones)
        self.chair.redraw(drawn, zones, self._setup.places)

    def follow(self, goals: tuple[Goal, ...] | None, now_ms: int) -> None:
        """Set off for new goals, again after a drive that ended early, and to the next wish after an arrival."""
        stage = self.chair.navigator.stage
        if goals is not None and goals != self._course:
            self._course, self._left, self._again.due_ms = goals, len(goals), None
            if goals:
                self._set_off()
            return
        if not self._course or self._asked_ms is None:
            return
        if stage is Stage.ARRIVED and self.driver.arrived_at(self._goals[0]):
            self.run.reached += 1
            self._end(now_ms)
        elif stage is Stage.FAILED:
            self._ask_again(now_ms)

    def blocked(self, now_ms: int, others: Sequence[Pose2]) -> dict[str, int]:
        """Return the section that the chair finds shut; see `ShutWays.step`."""
        if self.state is None:
            return {}
        return self._shut.step(now_ms, self.state.navigation, self.state.map_from_base, self.held, others)

    def reset(self, now_ms: int) -> None:
        """Reset a chair that is not ready, and ask at once for the drive that its faults ended: they are no try at this place."""
        self.chair.reset()
        self._again.tries = 0
        if self._course and self.chair.navigator.stage is Stage.FAILED:
            self._ask_again(now_ms)
            self._again.due_ms = now_ms

    def _ask_again(self, now_ms: int) -> None:
        """Ask again after a while, once the chair is ready; not for ever at one place."""
        assert self.state is not None
        again, here = self._again, self.state.map_from_base
        if again.due_ms is None:
            self.run.ends.append(self.chair.navigator.reason)
            again.due_ms = now_ms + round(1e3 * AGAIN_AFTER_S)
            if math.dist((here.x, here.y), (again.place.x, again.place.y)) > TRIED_WITHIN:
                again.tries, again.place = 0, here
        elif now_ms >= again.due_ms and self.chair.ready and again.tries < MOST_TRIES:
            again.tries += 1
            self.run.again += 1
            self._set_off()
            again.due_ms = None

    def _set_off(self) -> None:
        self.chair.go(*self._course[len(self._course) - self._left :])
        self.chair.confirm()

    def _end(self, now_ms: int) -> None:
        assert self._asked_ms is not None
        self.run.took_s.append((now_ms - self._asked_ms) / 1e3)
        self._goals.pop(0)
        self._asked_ms, self._course = None, ()


Keeper = Callable[[FleetScene, Ways, Sequence[Rider]], Callable[[int], tuple[Wait, ...]]]
"""Makes the step of an order: it gives the riders their authorities and goals, and returns the present waits."""


def drive_fleet(
    scene: FleetScene,
    on_moment: Callable[[FleetMoment], None] = lambda moment: None,
    events: Events = lambda simulator, chairs, seconds: None,
    settings: ChairSettings | None = None,
    keeper: Keeper | None = None,
) -> FleetRun:
    """Drive all chairs to all their goals, for at most the scene's time.

    `on_moment` is called at each step of the order, `events` before each tick, with the time [s], to change the scene.
    `keeper` keeps the order instead of the one warden that hears every report at once.

    Raises:
        WorldError: a chair does not fit at its start.
        TaskError: a start or goal is no refuge, or has no slot.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    ways = drivable(ways_of(scene.graph, SPEED), scene.body)
    plans = [
        ChairPlan(scene.body, randomised_settings(chair_seed(scene.seed, k)), scene.places[start].pose)
        for k, start in enumerate(scene.starts)
    ]
    simulator = FleetSimulator(scene.world, plans, scene.seed)
    run = FleetRun([ChairRun(len(goals)) for goals in scene.goals])
    setup = DriveSetup(
        scene.mapped, scene.places, scene.body, DEFAULT, chair=settings or ChairSettings(), zones=scene.zones
    )
    with ExitStack() as stack:
        chairs = [stack.enter_context(simulated_chair(setup, each)) for each in simulator.chairs]
        riders = [
            Rider(k, chair, setup, ChainDriver(ways, k, scene.body, dict(scene.places)), scene.goals[k], run.chairs[k])
            for k, chair in enumerate(chairs)
        ]
        keep = (keeper or one_warden)(scene, ways, riders)
        _drive(scene, simulator, riders, run, on_moment, events, keep)
    run.count_contacts(simulator)
    for own, chair, goals in zip(run.chairs, simulator.chairs, scene.goals, strict=True):
        own.note_end(scene.places[goals[-1]].pose, chair.truth())
    return run


def _drive(
    scene: FleetScene,
    simulator: FleetSimulator,
    riders: Sequence[Rider],
    run: FleetRun,
    on_moment: Callable[[FleetMoment], None],
    events: Events,
    keep: Callable[[int], tuple[Wait, ...]],
) -> None:
    sentences: dict[int, str] = {}
    for tick in ticks(simulator, run, scene.time_limit_s, lambda: all(rider.done for rider in riders)):
        now_ms = simulator.now_ns // 1_000_000
        events(simulator, [rider.chair for rider in riders], simulator.now_ns * 1e-9)
        if tick % STEPS_OF_ORDER == 0 and all(rider.state is not None for rider in riders):
            present = keep(now_ms)
            sentences = {wait.chair: wait.sentence for wait in present}
            run.audit.note(present, now_ms)
            for rider in riders:
                rider.held = rider.number in sentences and stands(simulator, rider.number)
            _note(run, simulator, riders)
            on_moment(_moment(simulator, riders, present))
        heard = advance_tick(simulator, [rider.chair for rider in riders])
        for rider, messages in zip(riders, heard, strict=True):
            others = [halt_as_told("fleet_waits", sentences[rider.number])] if rider.held else []
            rider.state = rider.chair.step(simulator.now_ns, messages, others)


def one_warden(
    scene: FleetScene,
    ways: Ways,
    riders: Sequence[Rider],
    changed: Callable[[Order, int], Order] = lambda order, now_ms: order,
    told: Callable[[Order, tuple[Wait, ...], int], None] = lambda order, present, now_ms: None,
) -> Callable[[int], tuple[Wait, ...]]:
    """Return the step of one warden for all chairs in this process.

    `changed` may give the requests of an order other priorities before each step; `told` hears order and waits after it.
    """
    district = WardenState(parked(ways, dict(enumerate(scene.starts))), CLEARING_MS, scene.seed)
    numbers = iter(range(1, 1 << 30))
    sentences: dict[int, str] = {}

    def keep(now_ms: int) -> tuple[Wait, ...]:
        nonlocal district, sentences
        district = replace(district, order=changed(district.order, now_ms))
        district, present = _keep_order(district, riders, sentences, numbers, now_ms)
        sentences = {wait.chair: wait.sentence for wait in present}
        told(district.order, present, now_ms)
        return present

    return keep


def _keep_order(
    district: WardenState, riders: Sequence[Rider], sentences: Mapping[int, str], numbers: Iterator[int], now_ms: int
) -> tuple[WardenState, tuple[Wait, ...]]:
    """Let every chair step along its chain and report, and the warden decide; give the chairs their authorities."""
    reports, requests = [], []
    blocked: dict[str, int] = {}
    for rider in riders:
        assert rider.state is not None
        steps = rider.driver.step(
            district.order, rider.state.map_from_base, now_ms, rider.count_goals(), sentences.get(rider.number, "")
        )
        rider.line = steps.authority.line
        rider.chair.navigator.granted.authority = steps.authority
        rider.keep_on_chain(steps)
        rider.follow(steps.goals, now_ms)
        found = rider.blocked(
            now_ms, [other.state.map_from_base for other in riders if other is not rider and other.state]
        )
        if found:
            district = replace(district, order=rider.driver.withdraw(district.order))
        blocked |= found
        reports.append(rider.driver.report() if found else steps.report)
        wish = rider.wish(now_ms, numbers)
        if wish is not None:
            requests.append(wish)
    district, _, present = decided(district, Heard(tuple(reports), tuple(requests), blocked), now_ms)
    return district, present


def ticks(simulator: FleetSimulator, run: FleetRun, limit_s: float, done: Callable[[], bool]) -> Iterator[int]:
    """Yield the number of each tick, in which the caller advances all chairs, until they are done or the time [s] is up.

    They are locked up, and the end has come, when none of them has moved for `LOCKED_UP_S`.
    """
    moved_ns, tick = 0, 0
    while simulator.now_ns < limit_s * 1e9 and not done():
        yield tick
        if not all(stands(simulator, number) for number in range(len(simulator.chairs))):
            moved_ns = simulator.now_ns
        if simulator.now_ns - moved_ns > LOCKED_UP_S * 1e9:
            run.lockups += 1
            break
        tick += 1
    run.seconds = simulator.now_ns * 1e-9


def advance_tick(simulator: FleetSimulator, chairs: Sequence[Chair]) -> list[list[SensorMessage]]:
    """Advance all chairs by one tick with heartbeats to their boards, and return the tick's messages of each."""
    heard: list[list[SensorMessage]] = [[] for _ in chairs]
    for _ in range(TICK_NS // BEAT_NS):
        for chair in chairs:
            chair.beat(simulator.now_ns)
        for messages, new in zip(heard, simulator.advance(BEAT_NS), strict=True):
            messages += new
    return heard


def stands(simulator: FleetSimulator, number: int) -> bool:
    """Return whether a chair is at rest."""
    twist = simulator.chairs[number].twist()
    return max(abs(twist.v), abs(twist.omega)) < _MOVES


def _note(run: FleetRun, simulator: FleetSimulator, riders: Sequence[Rider]) -> None:
    """Take down the figures of a step of the order."""
    step_s = STEPS_OF_ORDER * TICK_NS * 1e-9
    for rider, chair, own in zip(riders, simulator.chairs, run.chairs, strict=True):
        own.note(simulator.now_ns * 1e-9, chair, step_s * rider.held)
        own.note_line(rider.line, 0.0 if rider.line is None else beyond(rider.line, chair.body, chair.truth()))
    count = len(riders)
    run.nearest = min([run.nearest, *(simulator.between(a, b) for a in range(count) for b in range(a + 1, count))])


def beyond(line: FloatArray, body: ChairBody, pose: Pose2) -> float:
    """Return how far [m] a chair's outline is beyond a stop line that lies across it, on its farther side."""
    if not crosses(line, body, pose.array()[None])[0]:
        return 0.0
    a, b = line
    normal = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a))
    off = (transform_points(pose, body.outline()) - a) @ normal
    return float(min(off.max(), -off.min()))


def _moment(simulator: FleetSimulator, riders: Sequence[Rider], waits: tuple[Wait, ...]) -> FleetMoment:
    return FleetMoment(
        now_ns=simulator.now_ns,
        poses=tuple(chair.truth() for chair in simulator.chairs),
        states=tuple(rider.state for rider in riders if rider.state is not None),
        lines=tuple(rider.line for rider in riders),
        waits=waits,
        people=np.array([(p.pose.x, p.pose.y) for p in simulator.people]).reshape(-1, 2),
        reached=tuple(rider.run.reached for rider in riders),
    )
