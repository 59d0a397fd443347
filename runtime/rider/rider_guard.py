"""The guard of one chair: the level of help that the rider has chosen, and the caps of the rider's stick in each tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.stopping import StopTable
from waychair.control.haptics.guide_types import StickHold
from waychair.control.safety.collision_monitor import VERDICT_MS
from waychair.control.safety.guard import (
    GUARD_ENDED,
    GUARDED,
    SPOKEN,
    UNCALIBRATED,
    PressedOverride,
    Pushes,
    Unscanned,
    caps_of,
    crept,
    pushes_of,
)
from waychair.control.safety.own_bend import OwnBend
from waychair.control.safety.sight_speed import Sector
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.caps import STALE_CAP, Caps
from waychair.runtime.base_settings import BaseSettings
from waychair.runtime.monitor_process import MonitorPort
from waychair.types import HelpLevel, JoystickInput, SentCommand, Twist

HELD_MS = 500
"""ms for which the guidance's own hold of the stick counts; a guide that falls silent holds nobody."""

OVERRIDES = "For ten seconds you may creep against the guard, until you let go. It still stops before a drop-off."

NOTHING_HELD = "There is nothing to override: the guard does not hold the joystick."


class RiderGuard:
    """The chosen `level`, and the caps that it asks of the board; `unscanned` are the points in base that no scan
    shows; None while they ought to be known and are not: then no cap is wide. `own_caps`: the latest without the hold of the guidance.

    `offered`: the level that the rider chose last, maybe on another day; no level begins by itself.
    `told`: the last sentence about the level, for speech and page; it changes with each change of the level.
    """

    def __init__(
        self,
        body: ChairBody,
        stops: StopTable | None,
        settings: BaseSettings,
        monitor: MonitorPort,
        bridge: Bridge,
        *,
        calibrated: bool,
    ) -> None:
        """`calibrated`: the chair's joystick was measured, so that a deflection's motion is known."""
        self.level = self.offered = HelpLevel.INFORM
        self.told = ""
        self.unscanned: Unscanned | None = Unscanned()
        self.own_caps = Caps().each
        self._body, self._stops, self._settings = body, stops, settings
        self._monitor, self._bridge = monitor, bridge
        self._calibrated = calibrated
        self._pushes: Pushes | None = None
        self._hold: tuple[StickHold, int] | None = None
        self._override: PressedOverride | None = None
        self._bend = OwnBend()

    @property
    def wanted(self) -> bool:
        """Whether the rider has chosen a level in which the board guards."""
        return self.level in GUARDED

    def choose(self, level: HelpLevel) -> str:
        """Take a level by the rider's own act, at once; return the sentence to be spoken."""
        if level in GUARDED and not self._calibrated:
            level, self.told = HelpLevel.INFORM, UNCALIBRATED
        else:
            self.told = SPOKEN[level]
        if level in GUARDED and self.level not in GUARDED:
            self._bridge.reset()  # faults that the computer caused; no motion begins by it
        self.level, self._override = level, None
        self.offered = level
        return self.told

    def offer(self, level: HelpLevel) -> None:
        """Offer the level that the rider chose on another day, in a sentence; it begins by `choose` only."""
        self.offered = level
        if level is not self.level:
            self.told = f"Last time you chose {level.value}. Choose it again to begin."

    def override(self, now_ns: int) -> tuple[bool, str]:
        """Let the rider creep against the caps, by the rider's own act; return whether it may, and the sentence to be spoken.

        It lasts for `guard.OVERRIDE_S` at most, and until a pushed stick is let go. Caps by drop-offs stay.
        """
        telemetry = self._bridge.telemetry
        if not self.wanted or telemetry is None or telemetry.guard is None or telemetry.guard.lost:
            return False, NOTHING_HELD
        self._override, self.told = PressedOverride.begun(now_ns), OVERRIDES
        return True, OVERRIDES

    @property
    def overridden(self) -> bool:
        """Whether a press of the override lets the rider creep now."""
        return self._override is not None

    def hold_stick(self, hold: StickHold, now_ns: int) -> None:
        """Hold the stick for `HELD_MS` as the guidance asks: slow at a door, and without what was not asked for."""
        self._hold = hold, now_ns

    def limit(
        self, now_ns: int, stick: JoystickInput | None, measured: Twist, sectors: Sequence[Sector]
    ) -> SentCommand:
        """Send the board the caps of this tick; return the record of it. The level ends if the board has ended the guard."""
        hold = self._hold_now(now_ns)
        passed = stick if stick is None else replace(stick, turn=_passed_turn(stick.turn, hold))
        caps = self._caps(now_ns, passed, measured, sectors)
        self.own_caps = caps.each
        sent = self._bridge.limit(_held(caps, stick, hold), now_ns, now_ns)
        ended = self._bridge.guard_end
        if ended:
            self.level, self.told, self._override = HelpLevel.INFORM, f"{GUARD_ENDED}{ended}.", None
        return sent

    def _caps(self, now_ns: int, stick: JoystickInput | None, measured: Twist, sectors: Sequence[Sector]) -> Caps:
        """Return the caps by the monitor's latest answer, and ask it about the stick as it is now."""
        motion = self._bridge.stick_motion(self._body.track)
        if motion is None or stick is None:
            self._override = None
            return Caps()
        self._bend = self._bend.after(now_ns, stick.turn, measured, motion.bend)
        pushes = pushes_of(stick, motion, self._bend.bend)
        self._monitor.judge_pushes(pushes.twists, measured, now_ns)
        answer = self._monitor.pushes
        fresh = answer is not None and 0 <= now_ns - answer.stamp_ns <= VERDICT_MS * 1_000_000
        judged = self._judged(pushes, answer.twists) if answer is not None and fresh else None
        self._pushes = pushes
        caps = caps_of(
            pushes if judged is None else judged,
            None if judged is None or answer is None else answer.shares,
            sectors,
            self.unscanned or Unscanned(),
            motion,
            self._body,
            self._settings.monitor,
            self._settings.unseen,
            self._stops,
        )
        if self.unscanned is None:
            caps = caps.narrowed(STALE_CAP)
        if self._override is not None:
            self._override = self._override.after(now_ns, stick)
        return caps if self._override is None else crept(caps, stick, motion, self._body)

    def _hold_now(self, now_ns: int) -> StickHold:
        """Return the hold that the guidance asks for now; none by default, and while the rider overrides."""
        if self.level is not HelpLevel.GUIDE or self._hold is None or self.overridden:
            return StickHold()
        hold, asked_ns = self._hold
        return hold if 0 <= now_ns - asked_ns <= HELD_MS * 1_000_000 else StickHold()

    def _judged(self, pushes: Pushes, twists: tuple[Twist, ...]) -> Pushes | None:
        """Return the pushes of this tick or of the one before to which an answer belongs; None if it is of neither."""
        return next((each for each in (pushes, self._pushes) if each is not None and each.twists == twists), None)


def _stopped(turn: float, hold: StickHold) -> tuple[bool, bool]:
    """Return whether a hold stops a stick's turn to the left, and to the right."""
    return max(turn, 0.0) < hold.left, max(-turn, 0.0) < hold.right


def _passed_turn(turn: float, hold: StickHold) -> float:
    """Return what a hold passes of a stick's turn; a drift that it stops leads the chair nowhere, and is not judged."""
    left, right = _stopped(turn, hold)
    return 0.0 if (left if turn > 0.0 else right) else turn


def _held(caps: Caps, stick: JoystickInput | None, hold: StickHold) -> Caps:
    """Return the caps with those of a hold; a number that is none changes nothing."""
    left, right = _stopped(0.0 if stick is None else stick.turn, hold)
    return replace(
        caps,
        front=min(caps.front, hold.front),
        rear=min(caps.rear, hold.rear),
        left=0.0 if left else caps.left,
        right=0.0 if right else caps.right,
    )
