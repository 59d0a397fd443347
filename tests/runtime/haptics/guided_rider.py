"""A rider in an empty room with the glove's program, led by a `HapticGuide`, who obeys each symbol or stands still."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from tests.firmware_bridge.glove.rig import spans
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.commands import Signal
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.profile import HapticsProfile
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.program import GloveConfig, GloveInputs, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting
from waychair.runtime.haptics.haptic_guide import HapticGuide
from waychair.runtime.haptics.haptic_state import HapticInputs, HapticState
from waychair.runtime.haptics.sounds import Sounds
from waychair.runtime.haptics.teller import Teller
from waychair.runtime.senses.servo_camera_sight import ServoCameraTold
from waychair.types import GuardReport, HelpLevel, JoystickInput, OccupancyGrid, Place, Pose2, Twist

TICK_MS = 50
START, DESK = Pose2(1.0, 2.0, 0.0), Place("desk", Pose2(5.0, 2.0, 0.0), 0.3, 0.3)


def room() -> OccupancyGrid:
    """An empty room of 6 x 4 m."""
    cells = np.full((80, 120), 100, np.int8)
    cells[2:-2, 2:-2] = 0
    return OccupancyGrid(cells, 0.05)


class GuidedRider:
    """A chair that stands or moves by hand, and all that its rider is told; `voice` is the program that speaks, if any."""

    def __init__(
        self, config: GloveConfig | None = None, voice: Path | None = None, profile: HapticsProfile | None = None
    ) -> None:
        profile = profile or HapticsProfile()
        self.glove = HostGlove(glove_program(), config)
        bridge = GloveBridge(
            Reconnecting(lambda: self.glove.transport), "A", layout_named("glove_3x3"), profile.fitting()
        )
        self.sounds = Sounds(profile, {}.get if voice is None else {"espeak-ng": str(voice)}.get)
        self.guide = HapticGuide(CHAIR_A, Teller(profile, bridge, self.sounds), RiderLearner(), room())
        self.inputs = GloveInputs()
        self.pose: Pose2 | None = START
        self.odom_from_base: Pose2 | None = None
        self.twist = Twist()
        self.level, self.level_told = HelpLevel.GUIDE, ""
        self.signal: Signal | None = None
        self.guard: GuardReport | None = GuardReport((1.0, 1.0, 1.0, 1.0))
        self.stick: JoystickInput | None = None
        self.now_ms = 0
        self.states: list[HapticState] = []
        self.levels = np.zeros((0, 16), np.uint8)

    def __enter__(self) -> Self:
        self.run(300)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.glove.close()
        self.sounds.close()

    def run(self, ms: int, camera: ServoCameraTold | None = None) -> HapticState:
        """Let time pass, with the same news of a camera on servos in each tick; return the last state."""
        for _ in range(ms // TICK_MS):
            now = HapticInputs(
                self.now_ms * 1_000_000,
                self.pose,
                self.twist,
                self.level,
                self.level_told,
                self.stick,
                self.guard,
                signal=self.signal,
                camera=camera,
                odom_from_base=self.odom_from_base,
            )
            self.states.append(self.guide.step(now))
            self.now_ms += TICK_MS
            self.levels = np.concatenate([self.levels, self.glove.step(self.now_ms, self.inputs).levels])
            moved = Pose2(self.twist.v * TICK_MS / 1000, 0.0, self.twist.omega * TICK_MS / 1000)
            self.pose = None if self.pose is None else self.pose @ moved
            self.odom_from_base = None if self.odom_from_base is None else self.odom_from_base @ moved
        return self.states[-1]

    def press(self, *, yes: bool = False) -> None:
        """Press the glove's button "repeat", or "yes"."""
        self.inputs = GloveInputs(repeat=not yes, yes=yes)
        self.run(100)
        self.inputs = GloveInputs()
        self.run(100)

    def felt(self, since_ms: int) -> set[int]:
        """The motors that have vibrated since a time."""
        return {motor for motor in range(16) if spans(self.levels[since_ms:], motor)}

    def said(self, since: int = 0) -> list[str]:
        """The symbols said, in order, since a tick."""
        begin = max(since - 1, 0)
        pairs = zip(self.states[begin:], self.states[begin + 1 :], strict=False)
        return [after.symbol for before, after in pairs if after.count > before.count]
