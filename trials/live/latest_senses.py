"""The camera's latest picture and the latest state of the behaviour cells, made ready for a page only when it looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.runtime.chair import ChairState
from waychair.runtime.pages.perception_view import PerceptionView, perception_view
from waychair.runtime.perception import Perceived
from waychair.simulation.simulator import SimulatorSettings
from waychair.types import PanTiltAngles, RgbdFrame, SensorMessage, ServoMessage

_PICTURES_HZ = 2.0


class LatestPicture:
    """The camera's latest picture; it is encoded only when somebody looks at it."""

    def __init__(self) -> None:
        self._frame: RgbdFrame | None = None
        self._jpeg: tuple[int, bytes] | None = None

    def hear(self, messages: Sequence[SensorMessage]) -> None:
        """Take in the messages of a tick."""
        self._frame = next((each for each in reversed(messages) if isinstance(each, RgbdFrame)), self._frame)

    def jpeg(self) -> bytes | None:
        """Return the picture as JPEG; None before the first one."""
        frame, known = self._frame, self._jpeg
        if frame is None:
            return None
        if known is None or known[0] != frame.stamp_ns:
            done, data = cv2.imencode(".jpg", np.ascontiguousarray(frame.image[..., ::-1]))
            self._jpeg = known = frame.stamp_ns, bytes(data) if done else b""
        return known[1]


class LatestCells:
    """The behaviour cells after the latest tick, and the servos' report; the view is made only when somebody looks."""

    def __init__(self) -> None:
        self.perceived: Perceived | None = None
        self._aim: PanTiltAngles | None = None

    def hear(self, state: ChairState, looked: Sequence[ServoMessage]) -> None:
        """Take in a tick."""
        self.perceived = state.perceived
        self._aim = next((each for each in reversed(looked) if isinstance(each, PanTiltAngles)), self._aim)

    def view(self) -> PerceptionView | None:
        """Return what a page shows; None without cells."""
        perceived = self.perceived
        return None if perceived is None else perception_view(perceived, CHAIR_A, self._aim)


def with_pictures(settings: SimulatorSettings, camera: bool) -> SimulatorSettings:
    """Return the settings with few pictures for the page, if wanted; the chair does not use them."""
    return replace(settings, camera=replace(settings.camera, rate_hz=_PICTURES_HZ if camera else 0.0))
