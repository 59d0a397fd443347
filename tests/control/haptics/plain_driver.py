"""A driver on a chair of plain equations, and steps for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.guide import StepGuide
from waychair.control.haptics.guide_numbers import ALL, DRIFT
from waychair.control.haptics.guide_types import GuideInputs, GuideState, GuideWord, StickHold
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.rider import RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.door_steps import BEHIND, PIVOT_AHEAD, door_step
from waychair.planning.steps.step import Step, StepKind, StepPlan, with_pivots
from waychair.types import Pose2, Twist

HERE = Pose2()

DURATIONS = {symbol: 1e-3 * pattern.duration_ms for symbol, pattern in vocabulary("glove_3x3").patterns.items()}
TICK_S = 0.05


@dataclass
class PlainDriver:
    """Obeys every symbol after exactly the rider's lag, on a chair without inertia; the veer is the drift of the hand."""

    pose: Pose2
    rider: RiderModel
    deaf: bool = False
    twist: Twist = field(default_factory=Twist)

    def __post_init__(self) -> None:
        self._due: list[tuple[float, Symbol]] = []
        self._nudged: list[tuple[float, float]] = []
        self._held = Twist()

    def hear(self, symbol: Symbol, now_s: float) -> None:
        if not self.deaf:
            self._due.append((now_s + DURATIONS[symbol] + self.rider.lag_s, symbol))

    def step(self, now_s: float, hold: StickHold) -> None:
        rider = self.rider
        for due, symbol in [each for each in self._due if each[0] <= now_s]:
            self._due.remove((due, symbol))
            side = 1.0 if symbol in (Symbol.NUDGE_LEFT, Symbol.SWIVEL_LEFT) else -1.0
            if symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
                self._nudged.append((now_s + 0.2, side * rider.nudge / 0.2))
            elif symbol is Symbol.FORWARD:
                self._held = Twist(rider.speed, rider.veer_per_m * rider.speed)
            elif symbol is Symbol.BACK:
                self._held = Twist(-rider.speed, 0.0)
            elif symbol in (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT):
                self._held = Twist(0.0, side * rider.swivel)
            else:
                self._held = Twist()
        turn = self._held.omega + sum(rate for until, rate in self._nudged if until > now_s)
        passes_all = hold.left if turn > 0.0 else hold.right
        swivels = self._held.v == 0.0
        stopped = passes_all >= ALL or (passes_all >= DRIFT and not swivels and turn == self._held.omega)
        cap = hold.front if self._held.v > 0.0 else hold.rear
        self.twist = Twist(self._held.v * min(1.0, cap / PUSHED), 0.0 if stopped else turn)
        self.pose = self.pose @ Pose2(self.twist.v * TICK_S, 0.0, self.twist.omega * TICK_S)


@dataclass
class Drive:
    """A whole guided drive: the words by time, and the end."""

    said: list[tuple[float, Symbol]]
    last: GuideWord
    driver: PlainDriver
    seconds: float


PUSHED = 0.26
"""Share of the swing to which the plain driver pushes the stick ahead."""


def driven(
    plan: StepPlan, driver: PlainDriver, seconds: float = 120.0, known: RiderModel | None = None, *, held: bool = False
) -> Drive:
    """Lead a driver, of whom `known` is known, along steps; `held`: a guard holds the stick as the guide asks."""
    guide, state, said = (
        StepGuide(CHAIR_A, known or driver.rider, DURATIONS),
        GuideState(),
        list[tuple[float, Symbol]](),
    )
    tick, guidance = 0, None
    while guidance is None or not (guidance.arrived or guidance.astray or tick * TICK_S > seconds):
        tick += 1
        inputs = GuideInputs(tick * 50_000_000, driver.pose, driver.twist, holds=held)
        guidance, state = guide.step(plan, state, inputs)
        if guidance.advice is not None:
            said.append((tick * TICK_S, guidance.advice.symbol))
            driver.hear(guidance.advice.symbol, tick * TICK_S)
        driver.step(tick * TICK_S, guidance.hold if held else StickHold())
    return Drive(said, guidance, driver, tick * TICK_S)


def corner() -> StepPlan:
    """Return 3 m ahead, a left turn, 2 m ahead."""
    first = Step(StepKind.STRAIGHT, Pose2(), Pose2(3.0), room=0.3)
    second = Step(StepKind.STRAIGHT, Pose2(3.0, 0.0, math.pi / 2), Pose2(3.0, 2.0, math.pi / 2), room=0.3)
    return with_pivots(Pose2(), [first, second], None)


def through(door: DoorPassage, start: Pose2 = HERE) -> StepPlan:
    """Steps from a pose to the pivotal point of a door, and through it."""
    step = door_step(door, CHAIR_A, PIVOT_AHEAD[0], BEHIND[0])
    heading = math.atan2(step.start.y - start.y, step.start.x - start.x)
    begin, end = Pose2(start.x, start.y, heading), Pose2(step.start.x, step.start.y, heading)
    return with_pivots(start, [Step(StepKind.STRAIGHT, begin, end, room=0.14), step], None)


def open_leg(length: float) -> StepPlan:
    """Return one leg straight ahead, with nothing beside it."""
    return with_pivots(Pose2(), [Step(StepKind.STRAIGHT, Pose2(), Pose2(length), room=0.3)], None)
