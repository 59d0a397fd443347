"""Sonars and camera of the navigator's node, which passes their readings to its pilot, and tells the guard what they show."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from waychair.control.safety.fitness import has_valid_reading
from waychair.ros import topics
from waychair.ros.messages.camera import CameraPairing
from waychair.ros.messages.json_text import json_text
from waychair.ros.messages.sensors import SonarRing
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.runtime.pilot import Pilot
from waychair.runtime.rider.guard_points import GuardPoints
from waychair.slam.odometry.tilt import Tilt
from waychair.types import Pose2, RgbdFrame, SonarReadings

_SONARS = 8


class Piloted(Protocol):
    """The navigator's node."""

    @property
    def pilot(self) -> Pilot | None:
        """The pilot on the present map; None before the first map."""

    def tilt(self, stamp_ns: int) -> Tilt | None:
        """Return the chair's tilt, noted for a stamp; None while it is unknown."""

    def map_from_base(self, stamp_ns: int) -> Pose2 | None:
        """Return the chair's pose at a stamp; None while it is unknown."""


class NavigatorSenses:
    """The sonars, and with `camera` the camera; `camera_ns`: when a usable frame came last, by the steady clock."""

    def __init__(
        self, node: ChairNode[Any], piloted: Piloted, look: Callable[[RgbdFrame], None], *, camera: bool
    ) -> None:
        """`look` is shown each frame as well."""
        self._piloted, self._look = piloted, look
        self._with_true_stamp = known_chair(node.settings.calibration, node.settings.chair).with_true_stamp
        self._frame: RgbdFrame | None = None  # waits for the end of a tick
        self.camera_ns: int | None = None
        self._tell_guard = node.publisher(topics.UNSCANNED)
        ring = SonarRing(_SONARS)
        for k in range(_SONARS):

            def read(message: Any, k: int = k) -> SonarReadings | None:
                return ring.hear(k, message)

            node.listen(topics.sonar(k), read, self._take_sonars, needed=False)
        if camera:
            pairing = CameraPairing()
            node.listen(topics.DEPTH_INFO, lambda message: message, pairing.calibrated, needed=False)
            node.listen(topics.COLOUR, pairing.colour, self._take_frame, needed=False)
            node.listen(topics.DEPTH, pairing.depth, self._take_frame, needed=False)

    def _take_sonars(self, readings: SonarReadings | None) -> None:
        pose = None if readings is None else self._piloted.map_from_base(readings.stamp_ns)
        if readings is not None and self._piloted.pilot is not None and pose is not None:
            self._piloted.pilot.hear(readings, pose)

    def _take_frame(self, frame: RgbdFrame | None) -> None:
        if frame is not None and has_valid_reading(frame):  # a frame without any depth is ignored
            self._frame, self.camera_ns = self._with_true_stamp(frame), time.monotonic_ns()

    def tell_guard(self, stamp_ns: int, revision: int) -> None:
        """Tell the bridge of drop-offs, things that no scan shows and the reach of people near the chair, on the map of a revision."""
        pose, pilot = self._piloted.map_from_base(stamp_ns), self._piloted.pilot
        if pose is not None and pilot is not None:
            self._tell_guard(json_text(GuardPoints.near(stamp_ns, revision, pilot.unscanned, pose)))

    def process_camera(self) -> None:
        """Process the latest camera frame, just after a tick, since it takes much of the time to the next tick."""
        frame, self._frame = self._frame, None
        if frame is not None:
            self._look(frame)
        pose = None if frame is None else self._piloted.map_from_base(frame.stamp_ns)
        if frame is not None and self._piloted.pilot is not None and pose is not None:
            self._piloted.pilot.look(frame, pose, self._piloted.tilt(frame.stamp_ns))
