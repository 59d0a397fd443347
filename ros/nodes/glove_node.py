"""The glove node: it tells and leads a rider without sight by glove and voice. It drives nothing, and nothing waits for it.

| takes | |
|---|---|
| haptics/advice | symbols of other nodes to be felt and heard, each valid for a while |
| map, floor, localisation, odom, scan | to lead the rider: the map, the pose on it, and new things |
| guard, drive_state, stop | the level of help, a stick that is held back, the driver, and Stop |
| perception/state | the cells' signal, and the things and doorways round the chair for a rider that asks |

| sends | |
|---|---|
| haptics/state | the glove, the present step, the last symbol and the reason if it was not felt, as a page shows them |
| guard/seen_walls | to the bridge: walls near a chair whose rider is led without a map, in odom |

Services: `haptics/lead` (waychair_msgs/Lead: a place of the map), `haptics/lead_through` (waychair_msgs/LeadThrough: the next
doorway on a side, without a map), `haptics/end`, `haptics/say_again`, `haptics/say_where`
(std_srvs/Trigger).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from waychair.control.haptics.profile import HapticsProfile, load_profile
from waychair.control.haptics.symbols import Advice
from waychair.errors import ConfigError
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.transports import Reconnecting, check_port, transport_from_text
from waychair.ros import topics
from waychair.ros.messages.haptics import haptic_state, read_advice
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.node_settings.glove import GloveNodeSettings
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.ros.nodes.parts.led_rider import LedRider
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.learnt_file import default_learnt, load_learner, save_learner
from waychair.runtime.haptics.session_log import SessionCounter, SessionLog, default_session_log
from waychair.runtime.haptics.sounds import Sounds
from waychair.runtime.haptics.teller import Teller
from waychair.topics import COMMAND

_SHOWN_EVERY = 4
"""Ticks from one message of haptics/state to the next while nothing is said, and of walls that were seen."""

_MOST_WAITING = 8
"""Most pieces of advice that wait; beyond them the oldest is dropped."""

_OTHERS_FROM = 500_000_000
"""Numbers of advice of other nodes begin here, beyond those of the guide."""


class GloveNode(ChairNode[GloveNodeSettings]):
    """A node with the channels of one rider, and the guide that uses them."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        """
        Raises:
            ConfigError: there is no port, or the rider's file or the chair is impossible.
            CalibrationError: the chair's file is missing or damaged.
            TransportError: the port's name has no known form.
            GloveError: the fitting is for another layout.
            LearntError: the file of findings about the rider is damaged.
        """
        super().__init__("glove", GloveNodeSettings, arguments=arguments)
        s, profile = self.settings, HapticsProfile()
        if not s.port:
            raise ConfigError("the glove node has no glove: set its parameter port, or do not start it")
        check_port(s.port, "port")
        if s.profile:
            profile = load_profile(Path(s.profile))
        cable = Reconnecting(lambda: transport_from_text(s.port, "port"))
        self.at_end(cable.close)
        sounds = Sounds(profile)
        self.at_end(sounds.close)
        learnt = default_learnt() if s.profile else None  # nothing is kept of a rider who has no file
        learner = load_learner(learnt)
        self.at_end(lambda: save_learner(learnt, learner))
        bridge = GloveBridge(cable, profile.device_id, layout_named(profile.layout), profile.fitting())
        calibration = known_chair(s.calibration, s.chair)
        session = SessionCounter(
            SessionLog(default_session_log())
        )  # it records nothing before the rider's yes on the page
        self._rider = LedRider(self, calibration, Teller(profile, bridge, sounds), learner, s.scan_frame, session)
        self._wanted: list[Advice] = []
        self._state, self._ticks = HapticState(0), 0
        self._send_state = self.publisher(topics.HAPTIC_STATE)
        self.listen(topics.ADVICE, read_advice, self._take_advice, needed=False)
        self.every(COMMAND.rate_hz, self._tick)

    def reports(self) -> Iterable[Report]:
        """Report the glove, and each thing that is amiss with the rider's channels."""
        for notice in self._state.notices:
            yield Report("glove", DiagnosticLevel.WARN, notice)
        if not self._state.notices:
            yield Report("glove", DiagnosticLevel.OK, "the glove is worn and well")

    def _take_advice(self, advice: Advice) -> None:
        """Keep advice until it is said or too late; its validity is counted on the steady clock from here on."""
        until_ns = time.monotonic_ns() + advice.valid_until_ns - self.now_ns()
        heard = replace(advice, number=_OTHERS_FROM + advice.number, valid_until_ns=until_ns)
        kept = [each for each in self._wanted if each.number != heard.number]
        self._wanted = [*kept, heard][-_MOST_WAITING:]

    def _tick(self) -> None:
        """Say due advice, and tell of it."""
        now_ns = time.monotonic_ns()
        self._wanted = [each for each in self._wanted if each.valid_until_ns >= now_ns]
        count = self._state.count
        self._state = self._rider.step(now_ns, self._wanted)
        self._ticks += 1
        is_due = self._ticks % _SHOWN_EVERY == 0
        if is_due:
            self._rider.tell_walls()
        if is_due or self._state.count > count:
            self._send_state(haptic_state(self._state))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(GloveNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
