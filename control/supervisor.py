"""Who drives: one table from what is asked and known to the drive mode, read from the top, the first row that holds.

The computer drives only while a goal is active, nothing is wrong and the rider does nothing. A touch of the joystick
ends the drive at once and for good: it never resumes by itself. A fault makes the computer let go, which leaves the
rider's joystick live.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.types import DriveMode, JoystickInput


@dataclass(frozen=True, slots=True)
class SupervisorSettings(Settings):
    """When the rider's hand counts."""

    joystick_threshold: float = setting(0.1, "", "deflection that takes over", low=0.01, high=0.9)


@dataclass(frozen=True, slots=True)
class Situation:
    """What the supervisor looks at each tick; `faults` are plain sentences."""

    joystick: JoystickInput | None
    stop_pressed: bool
    goal_active: bool
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The mode of this tick and, unless the computer drives, why not."""

    mode: DriveMode
    reason: str = ""


def supervise(mode: DriveMode, situation: Situation, settings: SupervisorSettings) -> Verdict:
    """Mode that follows `mode` in a situation."""
    stick = situation.joystick
    if situation.stop_pressed:
        return Verdict(DriveMode.STOPPED, "Stop was pressed; ask for a goal again to drive on")
    if stick is not None and not _neutral(stick, settings.joystick_threshold):
        return Verdict(DriveMode.MANUAL, "the rider drives by joystick")
    if mode is DriveMode.STOPPED and not situation.goal_active:
        return Verdict(DriveMode.STOPPED, "Stop was pressed; ask for a goal to drive on")
    if situation.faults:
        return Verdict(DriveMode.MANUAL, situation.faults[0])
    if situation.goal_active:
        return Verdict(DriveMode.AUTONOMOUS)
    return Verdict(DriveMode.MANUAL, "no goal")


def _neutral(stick: JoystickInput, threshold: float) -> bool:
    """Whether the stick is surely at rest; a NaN counts as a hand on it."""
    return abs(stick.forward) <= threshold and abs(stick.turn) <= threshold
