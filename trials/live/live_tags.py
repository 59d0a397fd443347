"""AprilTags that a live chair's camera sees, read by a worker: they tell its storey, and set or confirm its place."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Executor, Future

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.building.hgraph import HGraph
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.journeys import Traveller
from waychair.runtime.tag_watch import LOOK_S, TagWatch, TagWord, words_of_tags
from waychair.slam.camera.seen_tags import seen_tags
from waychair.types import Pose2, RgbdFrame, SensorMessage


class LiveTags:
    """The tags of a building, seen by the camera of a chair that travels in it. The chair's own thread calls it."""

    def __init__(self, hgraph: HGraph, chair: Chair, traveller: Traveller, worker: Executor) -> None:
        self._hgraph, self._chair, self._traveller, self._worker = hgraph, chair, traveller, worker
        self._watch = TagWatch()
        self._last_ns = -(10**12)
        self._read: tuple[Future[tuple[TagWord, ...]], str, Pose2] | None = None
        """The words of a picture, the storey of the map and the chair in odom as it was taken."""

    def look(self, messages: Iterable[SensorMessage]) -> None:
        """Have the worker read the latest picture, if the last one has been read a while ago."""
        for frame in messages:
            if not isinstance(frame, RgbdFrame) or self._read is not None:
                continue
            if 0 <= frame.stamp_ns - self._last_ns < LOOK_S * 1e9:
                continue
            self._last_ns = frame.stamp_ns
            words = self._worker.submit(self._words, frame)
            self._read = words, self._traveller.storey, self._chair.odom_from_base

    def step(self, state: ChairState) -> None:
        """Act by what has been read."""
        if self._read is None or not self._read[0].done():
            return
        (read, storey, odom_from_base), self._read = self._read, None
        traveller, words = self._traveller, read.result()
        if traveller.aboard:
            for word in words:
                traveller.met_beacon(word.storey)
        elif storey == traveller.storey:
            other = next((word for word in words if word.storey != storey), None)
            if other is None:
                self._place(words, odom_from_base, state)
                return
            if traveller.journey is not None or state.verdict.computer_drives:
                traveller.cancel(state.stamp_ns)
                self._chair.cancel()  # at rest, the next look takes the storey
            else:
                traveller.take_storey(other.storey, other.map_from_base)
        self._watch.forget()

    def _words(self, frame: RgbdFrame) -> tuple[TagWord, ...]:
        return words_of_tags(self._hgraph, seen_tags(frame, CHAIR_A.base_from_camera))

    def _place(self, words: tuple[TagWord, ...], odom_from_base: Pose2, state: ChairState) -> None:
        pose = self._watch.place(words, odom_from_base, state.localisation, state.stamp_ns)
        if pose is not None:
            self._chair.relocalise(pose @ odom_from_base.inverse() @ self._chair.odom_from_base)
