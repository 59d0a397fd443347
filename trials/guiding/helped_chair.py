"""A simulated chair whose rider has chosen a level of help, one tick at a time: board, glove and rider in their order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.control.safety.guard import GUARDED
from waychair.runtime.chair import Chair, ChairState
from waychair.simulation.simulator import Simulator
from waychair.trials.drive import ARMED_S, READY_S, TICK_NS, advance_tick, look_round
from waychair.trials.guiding.live_haptics import HapticParts
from waychair.types import HelpLevel, SensorMessage

Ticked: TypeAlias = tuple[tuple[SensorMessage, ...], ChairState]
"""The messages of a tick, and the chair's state after it."""


@dataclass(frozen=True, slots=True)
class HelpedChair:
    """A chair in its simulator, with the parts by which its rider is told, if any."""

    simulator: Simulator
    chair: Chair
    parts: HapticParts = field(default_factory=HapticParts)

    def tick(self) -> Ticked:
        """Let a tick pass: sensors, software, camera on servos if any, glove, and a simulated driver's stick."""
        messages = advance_tick(self.simulator, self.chair)
        state = self.chair.step(self.simulator.now_ns, messages)
        look_round(self.simulator, self.chair, state)
        self.parts.beat(self.simulator)
        return messages, state

    def begin(self, level: HelpLevel) -> Iterator[Ticked]:
        """Let the chair find board, lidar and pose, choose the level, and yield the ticks until it helps.

        A chair that cannot, within the usual times, is left as it is: `guards` or its own sentence tell.
        """
        for _ in range(round(READY_S * 1e9 / TICK_NS)):
            messages, state = self.tick()
            yield messages, state
            if self.chair.ready and state.localisation is not None:
                break
        self.chair.choose_level(level)
        for _ in range(round(ARMED_S * 1e9 / TICK_NS) if level in GUARDED else 0):
            yield self.tick()
            if self.guards:
                break

    @property
    def guards(self) -> bool:
        """Whether the board guards the rider's stick, by its last report."""
        telemetry = self.chair.bridge.telemetry
        return telemetry is not None and telemetry.guard is not None
