"""Recorded drives of a whole chair, to be replayed into a black box as often as a test needs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from tests.runtime.riding import FAR, Ride
from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.chair_body import CHAIR_A
from waychair.firmware_bridge.protocol import HelloReply
from waychair.runtime.black_box.recorder import BlackBox, BlackBoxSettings, LoggedChair
from waychair.runtime.chair import ChairSettings, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.trials.drive import simulated_chair
from waychair.types import Goal, Place, Pose2

LOGGED_CHAIR = LoggedChair(
    ChairSettings(), ChairCalibration("A", "", CHAIR_A), {"lift": Place("lift", Pose2(10.0, 2.5, 0.0))}
)


@dataclass(slots=True)
class Drive:
    """A `ChairWatcher` that keeps requests and ticks."""

    told_before: dict[int, list[tuple[str, tuple[Goal, ...]]]] = field(default_factory=dict)
    notes: list[tuple[tuple[ChairMessage, ...], ChairState, HelloReply | None]] = field(default_factory=list)

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        self.told_before.setdefault(len(self.notes), []).append((what, goals))

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        self.notes.append((heard, state, board))

    def without_first(self, count: int) -> Drive:
        """The same without its first ticks, in which a chair that was just switched on has no data yet."""
        later = {index - count: told for index, told in self.told_before.items() if index >= count}
        return Drive(later, self.notes[count:])

    def tell(self, box: BlackBox, later_ns: int = 0) -> None:
        """Send all of it to a black box, no faster than the box can write."""
        for index, (heard, state, board) in enumerate(self.notes):
            for what, goals in self.told_before.get(index, ()):
                box.note_request(what, goals)
            wait_for(box)
            box.note_tick(heard, replace(state, stamp_ns=state.stamp_ns + later_ns), board)


def wait_for(box: BlackBox, most: int = 50) -> None:
    """Wait until the box has few messages left to write."""
    while box._queue.qsize() > most and not box.problem:
        time.sleep(0.001)


def driven(script: Callable[[Ride], None], ride: Ride | None = None) -> Drive:
    """The drive that a script makes in the hall; FAR is the place 'lift'."""
    ride, drive = ride or Ride(), Drive()
    with simulated_chair(ride.setup, ride.simulator, drive) as ride.chair:
        script(ride)
    return drive


def logged(folder: Path, drives: Iterable[Drive], settings: BlackBoxSettings | None = None) -> BlackBox:
    """Return a closed box with these drives, one after the other."""
    with BlackBox(folder, LOGGED_CHAIR, settings) as box:
        later_ns = 0
        for drive in drives:
            drive.tell(box, later_ns)
            later_ns += drive.notes[-1][1].stamp_ns + 50_000_000
    return box


__all__ = ["FAR", "LOGGED_CHAIR", "Drive", "driven", "logged", "wait_for"]
