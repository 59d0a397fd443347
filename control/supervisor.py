"""Who drives: one table from what is asked and known to the drive mode, read from the top, the first row that holds.

The computer drives only while a goal is active, nothing is wrong and the rider does nothing. A push of the joystick
ends the drive at once and for good: it never resumes by itself. A fault makes the computer let go, which leaves the
rider's joystick live.

The board decides by the same rule as `Override` within a millisecond, without this computer; whichever of the two is
more sensitive ends the drive. Only a deflection below the threshold can be blended with the computer's command, so a
rider with tremor or spasm needs both set alike, here and on the board, higher and longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.types import DriveMode, JoystickInput


@dataclass(frozen=True, slots=True)
class SupervisorSettings(Settings):
    """When the rider's hand counts; threshold and duration are the board's defaults (`BoardSettings.override_*`)."""

    override: float = setting(0.2, "", "deflection beyond which the rider takes over", low=0.021, high=0.8)
    override_ms: int = setting(10, "ms", "for at least this long", low=0, high=500)
    at_rest: float = setting(0.1, "", "deflection up to which no hand is on the stick", low=0.02, high=0.2)
    assist: bool = setting(False, "", "a hand on the stick slows the drive, instead of nothing until it takes over")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.override <= self.at_rest:
            raise ConfigError(
                f"override = {self.override:g} leaves no stick at rest: it must be more than at_rest = {self.at_rest:g}"
            )


@dataclass(frozen=True, slots=True)
class Situation:
    """What the supervisor looks at each tick.

    `joystick` None: unknown; `taken_over`: the rider pushes, or the board let the computer's command go because of
    that; `faults` are plain sentences.
    """

    joystick: JoystickInput | None
    taken_over: bool
    stop_pressed: bool
    goal_active: bool
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The mode of this tick, unless the computer drives why not, and the part of its speed that the rider leaves it."""

    mode: DriveMode
    reason: str = ""
    share: float = 1.0

    @property
    def computer_drives(self) -> bool:
        """Alone, or with the rider's hand on the stick."""
        return self.mode in (DriveMode.AUTONOMOUS, DriveMode.ASSISTED)


class Override:
    """Whether the rider pushes the stick: beyond the threshold without a break for as long as the settings say."""

    def __init__(self, settings: SupervisorSettings) -> None:
        self._settings = settings
        self._since_ns: int | None = None

    def update(self, stick: JoystickInput | None) -> bool:
        """Told what the stick says now; a NaN is a push at once, since it cannot be told from one."""
        if stick is None:
            self._since_ns = None
            return False
        deflection = deflection_of(stick)
        if deflection <= self._settings.override:
            self._since_ns = None
            return False
        self._since_ns = stick.stamp_ns if self._since_ns is None else self._since_ns
        held_ns = stick.stamp_ns - self._since_ns
        return math.isnan(deflection) or held_ns >= self._settings.override_ms * 1_000_000


def supervise(mode: DriveMode, situation: Situation, settings: SupervisorSettings) -> Verdict:
    """Mode that follows `mode` in a situation."""
    if situation.stop_pressed:
        return Verdict(DriveMode.STOPPED, "Stop was pressed; ask for a goal again to drive on")
    if situation.taken_over:
        return Verdict(DriveMode.MANUAL, "the rider drives by joystick")
    if mode is DriveMode.STOPPED and not situation.goal_active:
        return Verdict(DriveMode.STOPPED, "Stop was pressed; ask for a goal to drive on")
    if situation.faults:
        return Verdict(DriveMode.MANUAL, situation.faults[0])
    if not situation.goal_active:
        return Verdict(DriveMode.MANUAL, "no goal")
    share = _share(situation.joystick, settings) if settings.assist else 1.0
    if share < 1.0:
        return Verdict(DriveMode.ASSISTED, "the rider's hand on the joystick slows the drive", share)
    return Verdict(DriveMode.AUTONOMOUS)


def deflection_of(stick: JoystickInput) -> float:
    """The larger deflection of its two axes, as the board takes it; NaN when either is."""
    deflections = abs(stick.forward), abs(stick.turn)
    return math.nan if any(map(math.isnan, deflections)) else max(deflections)


def _share(stick: JoystickInput | None, settings: SupervisorSettings) -> float:
    """Full at rest and none at the threshold, so that the rider takes over a chair that stands."""
    if stick is None:
        return 1.0
    way = (deflection_of(stick) - settings.at_rest) / (settings.override - settings.at_rest)
    return min(1.0, max(0.0, 1.0 - way))
