"""The level of help and the board's guard as a page shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from waychair.control.safety.guard import GUARDED
from waychair.types import GuardReport, HelpLevel, Telemetry


@dataclass(frozen=True, slots=True)
class GuardView:
    """The level of help, the last sentence about it (`told`), and the level that the rider chose last (`offered`).

    `caps`: of the board, in [0, 1] of the swing to the front, the rear, the left and the right, None while it does not guard;
    `own_caps`: those that the guard asks for by itself, without the hold of the guidance.
    `creeps`: an override by a press lasts. The other flags are those of `types.GuardReport`. `stick`: the rider's joystick,
    forward and turn in [-1, 1], left positive.
    """

    level: HelpLevel = HelpLevel.INFORM
    told: str = ""
    offered: HelpLevel = HelpLevel.INFORM
    caps: tuple[float, float, float, float] | None = None
    capped: bool = False
    warns: bool = False
    overridden: bool = False
    lost: bool = False
    creeps: bool = False
    stick: tuple[float, float] = (0.0, 0.0)
    own_caps: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)

    @property
    def waits(self) -> bool:
        """Whether the board does not guard yet: it begins once the joystick has been at rest for two seconds."""
        return self.level in GUARDED and self.caps is None

    @property
    def report(self) -> GuardReport | None:
        """The board's own report, None while it does not guard."""
        if self.caps is None:
            return None
        return GuardReport(self.caps, self.capped, self.warns, self.overridden, self.lost)


class HelpState(Protocol):
    """The level of help of a chair, as `runtime.rider_guard.RiderGuard` holds it."""

    @property
    def level(self) -> HelpLevel:
        """The level now."""

    @property
    def told(self) -> str:
        """The last sentence about it."""

    @property
    def offered(self) -> HelpLevel:
        """The level that the rider chose last."""

    @property
    def overridden(self) -> bool:
        """Whether an override by a press lasts."""

    @property
    def own_caps(self) -> tuple[float, float, float, float]:
        """The guard's latest caps without the hold of the guidance."""


def guard_view(help_now: HelpState, telemetry: Telemetry | None) -> GuardView:
    """Return the page's view of a level and of the board's guard by its last report; None: no usable board."""
    report = None if telemetry is None else telemetry.guard
    level, told, offered, creeps = help_now.level, help_now.told, help_now.offered, help_now.overridden
    stick = (0.0, 0.0) if telemetry is None else (telemetry.joystick.forward, telemetry.joystick.turn)
    if report is None:
        return GuardView(level, told, offered, creeps=creeps, stick=stick)
    return GuardView(
        level=level,
        told=told,
        offered=offered,
        caps=report.caps,
        capped=report.capped,
        warns=report.warns,
        overridden=report.overridden,
        lost=report.lost,
        creeps=creeps,
        stick=stick,
        own_caps=help_now.own_caps,
    )
