"""The glove node: plays advice on a rider's glove and speaks it. It drives nothing, and nothing waits for it.

| takes | |
|---|---|
| haptics/advice | symbols to be felt and heard, each valid for a while |

| sends | |
|---|---|
| haptics/state | the glove, the symbol said last and why it was not felt, as a page shows them |
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
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.sounds import Sounds
from waychair.runtime.haptics.teller import Teller

TICK_HZ = 50.0
"""Rate of the session with the glove: advice reaches it within 20 ms."""

_SHOWN_EVERY = 10
"""Ticks from one message of haptics/state to the next while nothing is said."""

_MOST_WAITING = 8
"""Most pieces of advice that wait; beyond them the oldest is dropped."""


class GloveNode(ChairNode[GloveNodeSettings]):
    """A node with the `Teller` of one rider."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        """
        Raises:
            ConfigError: there is no port, or the rider's file is impossible.
            TransportError: the port's name has no known form.
            GloveError: the fitting is for another layout.
        """
        super().__init__("glove", GloveNodeSettings, arguments=arguments)
        port, profile = self.settings.port, HapticsProfile()
        if not port:
            raise ConfigError("the glove node has no glove: set its parameter port, or do not start it")
        check_port(port, "port")
        if self.settings.profile:
            profile = load_profile(Path(self.settings.profile))
        cable = Reconnecting(lambda: transport_from_text(port, "port"))
        self.at_end(cable.close)
        sounds = Sounds(profile)
        self.at_end(sounds.close)
        bridge = GloveBridge(cable, profile.device_id, layout_named(profile.layout), profile.fitting())
        self._teller = Teller(profile, bridge, sounds)
        self._wanted: list[Advice] = []
        self._state, self._ticks = HapticState(0), 0
        self._send_state = self.publisher(topics.HAPTIC_STATE)
        self.listen(topics.ADVICE, read_advice, self._take_advice, needed=False)
        self.every(TICK_HZ, self._tick)

    def reports(self) -> Iterable[Report]:
        """Report the glove, and each thing that is amiss with the rider's channels."""
        for notice in self._state.notices:
            yield Report("glove", DiagnosticLevel.WARN, notice)
        if not self._state.notices:
            yield Report("glove", DiagnosticLevel.OK, "the glove is worn and well")

    def _take_advice(self, advice: Advice) -> None:
        """Keep advice until it is said or too late; its validity is counted on the steady clock from here on."""
        left_ns = advice.valid_until_ns - self.now_ns()
        kept = [each for each in self._wanted if each.number != advice.number]
        self._wanted = [*kept, replace(advice, valid_until_ns=time.monotonic_ns() + left_ns)][-_MOST_WAITING:]

    def _tick(self) -> None:
        """Say what is due, and tell of it."""
        now_ns = time.monotonic_ns()
        self._wanted = [each for each in self._wanted if each.valid_until_ns >= now_ns]
        told = self._teller.tick(self._wanted, now_ns, reacted=True)  # the sender counts what is ignored
        self._state = self._teller.shown(self._state, told, now_ns)
        self._ticks += 1
        if told.said is not None or self._ticks % _SHOWN_EVERY == 0:
            self._send_state(haptic_state(self._state))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(GloveNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
