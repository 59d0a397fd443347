"""The real-time loop of a chair in a simulator, in a thread of its own.

Only this thread touches chair and simulator. Requests from other threads are served between two heartbeats of the
board, within a few milliseconds; the caller waits at most `ANSWER_S` for the answer.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from typing import Protocol, TypeVar

from waychair.control.safety.stops import Halt
from waychair.errors import WaychairError
from waychair.firmware_bridge.protocol import Holder
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.pages.chair_port import ANSWER_S
from waychair.runtime.pages.page_watch import PageWatch
from waychair.simulation.simulator import Simulator
from waychair.trials.drive import BEAT_NS, TICK_NS
from waychair.types import RgbdFrame, SensorMessage

T = TypeVar("T")

_GREATEST_LAG_NS = 50_000_000
"""A longer delay is not caught up: simulated time falls behind for good."""


@dataclass(slots=True)
class LoopTiming:
    """Timing figures: ticks, late ticks, time given up [s], and CPU time per tick [s], smoothed and longest."""

    ticks: int = 0
    late: int = 0
    lost_s: float = 0.0
    tick_s: float = 0.0
    longest_tick_s: float = 0.0


_HANDOVER_BEATS = 5
"""Heartbeats after the stop; the board releases the lines within 20 ms of the command."""


class Stepper(Protocol):
    """A chair's tick, such as that of a chair which travels over storeys, and whether something goes on by itself."""

    @property
    def under_way(self) -> bool: ...
    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt]) -> ChairState: ...


class RealTimeLoop:
    """The thread's loop. `on_tick` is called with each tick's messages and state."""

    def __init__(
        self,
        chair: Chair,
        simulator: Simulator,
        on_tick: Callable[[tuple[SensorMessage, ...], ChairState], None],
        stepper: Stepper | None = None,
        on_beat: Sequence[Callable[[Simulator], None]] = (),
    ) -> None:
        """`stepper` runs the chair's ticks, by default the chair itself; all of `on_beat` are called with each heartbeat."""
        self.timing = LoopTiming()
        self.watch = PageWatch()
        self.free_since_ns: int | None = time.monotonic_ns()
        """Time since which the rider's joystick is on the lines; None while the board holds them."""
        self._chair, self._simulator, self._on_tick, self._stepper = chair, simulator, on_tick, stepper
        self._on_beat = on_beat
        self._requests: deque[tuple[Callable[[], object], Future[object]]] = deque()
        self._wake = threading.Event()
        self._ended = False
        self._messages: list[SensorMessage] = []
        self._due_ns = 0

    def ask(self, function: Callable[[], T], first: bool = False) -> T:
        """Run a function in the thread and return its result; with `first` it precedes all waiting requests.

        Raises:
            WaychairError: the function raised it, or there was no answer in time.
        """
        future: Future[object] = Future()
        (self._requests.appendleft if first else self._requests.append)((function, future))
        self._wake.set()
        try:
            answer: T = future.result(ANSWER_S)  # type: ignore[assignment]
        except FutureTimeout as error:
            raise WaychairError(f"the chair did not answer within {ANSWER_S:g} s: check whether it stands") from error
        return answer

    def tell(self, function: Callable[[], object]) -> None:
        """Run a function in the thread without waiting for it."""
        self._requests.append((function, Future()))
        self._wake.set()

    def end(self) -> None:
        """Request the end of the loop."""
        self._ended = True
        self._wake.set()

    def run(self) -> None:
        """Run until `end`, then stop the chair and release the lines."""
        self._due_ns = time.monotonic_ns()
        try:
            while not self._ended:
                for _ in range(TICK_NS // BEAT_NS):
                    self._wait()
                    self._beat()
                self.step()
        finally:
            self._chair.stop()
            self.step()
            for _ in range(_HANDOVER_BEATS):
                self._beat()
            self._refuse_waiting()

    def step(self) -> ChairState:
        """Run a tick of the chair: the regular one, or an extra one right after a request."""
        messages, self._messages = tuple(self._messages), []
        started, now_ns = time.thread_time(), time.monotonic_ns()
        to_drive = (message for message in messages if not isinstance(message, RgbdFrame))  # pictures are only shown
        stepper = self._stepper
        step = self._chair.step if stepper is None else stepper.step
        state = step(self._simulator.now_ns, to_drive, self.watch.halts(now_ns))
        if not state.verdict.computer_drives and (stepper is None or not stepper.under_way):
            self.watch.over()
        self._on_tick(messages, state)
        spent = time.thread_time() - started
        timing = self.timing
        timing.ticks += 1
        timing.tick_s += 0.05 * (spent - timing.tick_s)
        timing.longest_tick_s = max(timing.longest_tick_s, spent)
        return state

    def _beat(self) -> None:
        """Advance the world by one heartbeat period, with a heartbeat to the board."""
        self._chair.beat(self._simulator.now_ns)
        self._messages += self._simulator.advance(BEAT_NS)
        for each in self._on_beat:
            each(self._simulator)
        lines = self._simulator.lines
        if lines is None or lines.holder != Holder.BOARD:
            self.free_since_ns = self.free_since_ns or time.monotonic_ns()
        else:
            self.free_since_ns = None

    def _wait(self) -> None:
        """Wait until the next beat is due, serving requests meanwhile."""
        self._due_ns += BEAT_NS
        while True:
            self._wake.clear()
            self._serve()
            left_ns = self._due_ns - time.monotonic_ns()
            if left_ns <= 0 or self._ended:
                break
            self._wake.wait(left_ns * 1e-9)
        late_ns = time.monotonic_ns() - self._due_ns
        if late_ns > _GREATEST_LAG_NS:
            self.timing.late += 1
            self.timing.lost_s += late_ns * 1e-9
            logging.getLogger(__name__).warning("a tick of the simulated chair was %.0f ms late", late_ns * 1e-6)
            self._due_ns += late_ns

    def _serve(self) -> None:
        while self._requests:
            function, future = self._requests.popleft()
            try:
                future.set_result(function())
            except WaychairError as error:
                future.set_exception(error)

    def _refuse_waiting(self) -> None:
        """Answer all waiting requests with an error."""
        while self._requests:
            self._requests.popleft()[1].set_exception(WaychairError("the simulated chair has ended: start it again"))
