"""A drive of the complete simulated chair through a `DrivenSituation`, watched as its rider would: rests, turns, words."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field, replace

from evaluation.scenes.situations import DrivenSituation, SituationEvent
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.drive.navigation import ACTIVE, Stage
from waychair.errors import WaychairError
from waychair.geometry import wrap_angle
from waychair.runtime.chair import Chair, ChairState
from waychair.simulation.simulator import Simulator
from waychair.topics import COMMAND
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import READY_S, DriveSetup, advance_tick, simulated_chair
from waychair.types import Goal, JoystickInput, Pose2, Twist

STANDS = 0.02
"""A chair stands below this sum of speed and turn rate [m/s, rad/s]."""

TURNS_WITHIN, STRAIGHT_ON = 0.5, 1.0
"""[m] Turns are in a row until the chair is displaced by the first, reversals until it has driven the second one way."""

_ESTIMATE = re.compile(r"\d+(\.\d+)? ?(s|min|m/s)\b")

CAUSES = (
    ("footrests", r"footrest|the chair itself|calibrate mask|\bown "),
    ("encoders", r"encoder|wheels? (is|are) (exchanged|reversed)|count"),
    ("stick", r"joystick"),
    ("lidar", r"lidar|\bscans?\b"),
    ("one-way zone", r"one-way"),
    ("zone", r"\bzone"),
    ("person", r"somebody|person|people|legs"),
    ("heading", r"heading"),
    ("width", r"wide enough|narrow|\bwide\b"),
    ("shut on the map", r"on the map"),
    ("shut", r"shut"),
    ("goal", r"at the goal|outside the map"),
    ("room", r"room|does not fit|close|in the way|no way"),
)
"""The cause that a text names: the first whose words it contains."""


@dataclass(frozen=True, slots=True)
class WatchedDrive:
    """What a rider saw: `rest_s` is the longest rest in a drive without a sentence, `unsaid_s` without an estimate, too.

    `turned` [degrees] and `reversals` are the most in a row. `texts` holds each sentence with its seconds.
    """

    kind: str
    seed: int
    outcome: str
    cause: str
    named: str
    rest_s: float
    unsaid_s: float
    turned: float
    reversals: int
    contacts: int
    seconds: float
    way_m: float
    reason: str
    texts: dict[str, float] = field(default_factory=dict)


def cause_named(text: str) -> str:
    """Return the cause that a text names, `""` where it names none."""
    return next((cause for cause, words in CAUSES if re.search(words, text)), "")


def watch(found: DrivenSituation, seed: int) -> WatchedDrive:
    """Drive a simulated chair of this seed through a situation.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    settings = randomised_settings(seed)
    if found.lidar_hz:
        settings = replace(settings, lidar=replace(settings.lidar, rate_hz=found.lidar_hz))
    simulator = Simulator(found.world, CHAIR_A, settings, seed)
    setup = DriveSetup(
        grid=found.grid,
        places={"goal": found.goal},
        body=CHAIR_A,
        calibration=DEFAULT,
        chair=found.chair,
        zones=found.zones,
    )
    rider = _Rider(found)
    try:
        with simulated_chair(setup, simulator) as chair:
            rider.drive(simulator, chair)
    except WaychairError as error:
        rider.refused = str(error)
    return rider.report(simulator, seed)


class _Rider:
    """Watches a drive tick by tick."""

    def __init__(self, situation: DrivenSituation) -> None:
        self._situation = situation
        self._events = list(situation.events)
        self._texts: Counter[str] = Counter()
        self._rest = self._unsaid = self._longest_rest = self._longest_unsaid = 0.0
        self._turning, self._reversing = _TurnsInARow(), _ReversalsInARow()
        self._way = 0.0
        self._state: ChairState | None = None
        self._began_ns = 0
        self.refused = ""

    def drive(self, simulator: Simulator, chair: Chair) -> None:
        for _ in range(round(READY_S * COMMAND.rate_hz)):
            if chair.ready:
                break
            self._step(simulator, chair)
        simulator.rider = JoystickInput(simulator.now_ns, self._situation.stick, 0.0)
        chair.go(Goal("goal"))
        chair.confirm()
        self._began_ns = simulator.now_ns
        while (simulator.now_ns - self._began_ns) * 1e-9 < self._situation.limit_s:
            self._let_happen(simulator, chair, (simulator.now_ns - self._began_ns) * 1e-9)
            state = self._step(simulator, chair)
            self._note(simulator, chair, state)
            if not chair.waits and state.navigation.stage in (Stage.ARRIVED, Stage.FAILED):
                break

    def _step(self, simulator: Simulator, chair: Chair) -> ChairState:
        messages, alter = advance_tick(simulator, chair), self._situation.alter
        self._state = chair.step(simulator.now_ns, messages if alter is None else alter(messages))
        return self._state

    def _let_happen(self, simulator: Simulator, chair: Chair, now_s: float) -> None:
        due = [event for event in self._events if event.after_s <= now_s]
        self._events = [event for event in self._events if event.after_s > now_s]
        for event in due:
            self._happen(simulator, chair, event)

    def _happen(self, simulator: Simulator, chair: Chair, event: SituationEvent) -> None:
        if event.what == "leave":
            simulator.populate(())
        elif event.what == "open" and self._situation.opened is not None:
            simulator.refurnish(self._situation.opened)
        elif event.what == "pause":
            chair.pause()
        elif event.what == "go on":
            chair.go_on()

    def _note(self, simulator: Simulator, chair: Chair, state: ChairState) -> None:
        tick_s, twist, pose = 1.0 / COMMAND.rate_hz, simulator.twist(), simulator.truth()
        self._way += abs(twist.v) * tick_s
        self._turning.note(pose)
        self._reversing.note(twist, tick_s)
        stage, counts_down = state.navigation.stage, chair.countdown_s(state.stamp_ns) is not None
        text = "; ".join([*dict.fromkeys(halted.text for halted in state.halts), state.navigation.reason]).strip("; ")
        if text and stage is not Stage.PAUSED:
            self._texts[text] += tick_s  # type: ignore[assignment]
        stands = abs(twist.v) + abs(twist.omega) < STANDS
        drives = stage in ACTIVE and stage is not Stage.PAUSED and not counts_down
        self._rest = self._rest + tick_s if stands and drives and not text else 0.0
        said = bool(text) and _ESTIMATE.search(text) is not None
        self._unsaid = self._unsaid + tick_s if stands and drives and not said else 0.0
        self._longest_rest = max(self._longest_rest, self._rest)
        self._longest_unsaid = max(self._longest_unsaid, self._unsaid)

    def report(self, simulator: Simulator, seed: int) -> WatchedDrive:
        found, state = self._situation, self._state
        stage = Stage.FAILED if self.refused or state is None else state.navigation.stage
        reason = self.refused or ("" if state is None else state.navigation.reason or state.verdict.reason)
        outcome = stage.value
        if stage is Stage.ARRIVED:
            pose, goal = simulator.truth(), found.goal
            away = math.dist((pose.x, pose.y), (goal.pose.x, goal.pose.y))
            turned = abs(wrap_angle(pose.theta - goal.pose.theta))
            outcome = "reached" if away <= goal.tolerance_m and turned <= goal.tolerance_rad else "missed"
        elif stage is Stage.FAILED:
            outcome = "given up" if self._way > 0.1 else "refused"
        return WatchedDrive(
            kind=found.kind,
            seed=seed,
            outcome=outcome,
            cause=found.cause,
            named=self._named(reason if stage is Stage.FAILED else ""),
            rest_s=round(self._longest_rest, 2),
            unsaid_s=round(self._longest_unsaid, 2),
            turned=round(math.degrees(self._turning.most)),
            reversals=self._reversing.most,
            contacts=simulator.contacts,
            seconds=round((simulator.now_ns - self._began_ns) * 1e-9, 1),
            way_m=round(self._way, 2),
            reason=reason,
            texts={text: round(seconds, 1) for text, seconds in self._texts.most_common(6)},
        )

    def _named(self, reason: str) -> str:
        """Return the cause named at the drive's end, or else the one named for longest."""
        if reason:
            return cause_named(reason)
        named: Counter[str] = Counter()
        for text, seconds in self._texts.items():
            if (cause := cause_named(text)) and seconds >= 0.5:
                named[cause] += seconds
        return named.most_common(1)[0][0] if named else ""


class _TurnsInARow:
    """Radians turned while the chair stays within `TURNS_WITHIN` of where it began to turn."""

    def __init__(self) -> None:
        self._at: Pose2 | None = None
        self._before = 0.0
        self._turned = self.most = 0.0

    def note(self, pose: Pose2) -> None:
        if self._at is None or math.dist((pose.x, pose.y), (self._at.x, self._at.y)) > TURNS_WITHIN:
            self._at, self._turned = pose, 0.0
        else:
            self._turned += abs(wrap_angle(pose.theta - self._before))
        self._before = pose.theta
        self.most = max(self.most, self._turned)


class _ReversalsInARow:
    """Changes of gear without `STRAIGHT_ON` metres one way between them."""

    def __init__(self) -> None:
        self._gear, self._way, self._count, self.most = 0.0, 0.0, 0, 0

    def note(self, twist: Twist, tick_s: float) -> None:
        if abs(twist.v) < 0.03:
            return
        gear = math.copysign(1.0, twist.v)
        if self._gear and gear != self._gear:
            self._count, self._way = self._count + 1, 0.0
        self._gear, self._way = gear, self._way + abs(twist.v) * tick_s
        if self._way > STRAIGHT_ON:
            self._count = 0
        self.most = max(self.most, self._count)
