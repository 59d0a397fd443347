"""The state of a chair after a tick, and its observers: what a black box or a page is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from waychair.control.drive.navigator import Navigation
from waychair.control.safety.stops import Halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.firmware_bridge.protocol import HelloReply
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.perception import Perceived
from waychair.slam.localising.localiser import Localisation
from waychair.types import Goal, Pose2, SentCommand, Telemetry, Twist


@dataclass(frozen=True, slots=True)
class ChairState:
    """The chair after one tick: pose, driver and reason, requested twist, and the command that was sent.

    `halts`: every stop that is active, each with its remedy. `command`: the navigator's twist within the limits, None
    when the computer does not drive. `telemetry` is the board's last report, None while no usable board is connected.
    `perceived`: the behaviour cells, None without them. `haptics`: glove, voice and steps of a rider without sight, None
    without them.
    """

    stamp_ns: int
    map_from_base: Pose2
    twist: Twist
    localisation: Localisation | None
    verdict: SupervisorVerdict
    halts: tuple[Halt, ...]
    navigation: Navigation
    command: Twist | None
    sent: SentCommand
    telemetry: Telemetry | None
    perceived: Perceived | None = None
    haptics: HapticState | None = None


class ChairWatcher(Protocol):
    """An observer of a chair's ticks, such as a black box. It must neither wait nor raise."""

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """Note a request to the chair: go (to these goals), confirm, cancel, stop or reset; no other is passed on."""

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        """Note a tick that is over: the messages of it, the chair's state after it, and the board's greeting."""


class Watchers:
    """Several watchers of one chair as one; None is none."""

    def __init__(self, *watchers: ChairWatcher | None) -> None:
        self._watchers = tuple(each for each in watchers if each is not None)

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """See `ChairWatcher`."""
        for each in self._watchers:
            each.note_request(what, goals)

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        """See `ChairWatcher`."""
        for each in self._watchers:
            each.note_tick(heard, state, board)
