"""The pace of simulated time: real time, as fast as possible, or one tick per answer of an external driver.

A simulation is a loop of ticks: the driver gets the sensors' messages and sets the joystick lines, then the simulator
advances. A driver in the same process always answers within the tick. A driver at the other end of a cable may not: its
runs are repeatable only in `LOCKSTEP`.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from typing import Protocol

from waychair.errors import DriverSilent


class PaceMode(enum.Enum):
    """The event for which the simulation waits after each tick."""

    LOCKSTEP = "lockstep"  # the driver's answer, up to a timeout
    FAST = "fast"  # none
    REALTIME = "realtime"  # the real clock


ANSWER_TIMEOUT_S = 5.0
"""In lockstep a driver that takes longer to answer has failed."""

SLACK_S = 0.1
"""In real time a delay is caught up to this extent only."""


class Driver(Protocol):
    """A driver of the chair outside this process, such as the peer of a `PseudoTerminal`."""

    def wait(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` for an answer; return whether it can be read."""
        ...


class Pacer:
    """Delays a simulation after each tick and measures its real-time factor.

    In real time a short delay is caught up. Of a longer delay only `slack_s` is caught up, so that the simulation does
    not race after a stall; `lost_s` is the rest.
    """

    def __init__(
        self,
        mode: PaceMode = PaceMode.FAST,
        driver: Driver | None = None,
        *,
        timeout_s: float = ANSWER_TIMEOUT_S,
        slack_s: float = SLACK_S,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Lockstep waits for `driver`; None means a driver in this process, which needs no waiting.

        `clock` gives monotonic nanoseconds.
        """
        self.mode = mode
        self._driver = driver
        self._timeout_s = timeout_s
        self._slack_ns = round(slack_s * 1e9)
        self._clock = clock
        self._sleep = sleep
        self._began: tuple[int, int] | None = None  # real and simulated time of the first call
        self._now_ns = 0
        self._lost_ns = 0

    def pace(self, now_ns: int) -> None:
        """Wait after a tick at simulated time `now_ns`; a call with an old time does nothing. Does not read the answer.

        Raises:
            DriverSilent: in lockstep no answer came before the timeout.
        """
        if self._began is None:
            self._began = self._clock(), now_ns
        elif now_ns <= self._now_ns:
            return
        self._now_ns = now_ns
        if self.mode is PaceMode.REALTIME:
            self._wait_for_real_time()
        elif self.mode is PaceMode.LOCKSTEP and self._driver is not None and not self._driver.wait(self._timeout_s):
            raise DriverSilent(
                f"the driver has not answered for {self._timeout_s:g} s at {now_ns * 1e-9:.3f} s of simulated time; "
                "start it, or take the mode fast or realtime"
            )

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per real second so far; 0 before any time has passed."""
        if self._began is None:
            return 0.0
        wall_ns = self._clock() - self._began[0]
        return (self._now_ns - self._began[1]) / wall_ns if wall_ns > 0 else 0.0

    @property
    def lost_s(self) -> float:
        """Seconds by which a real-time simulation fell behind for good; 0 if it kept up."""
        return self._lost_ns * 1e-9

    def _wait_for_real_time(self) -> None:
        assert self._began is not None
        wall_ns, simulated_ns = self._began
        due_ns = wall_ns + self._lost_ns + self._now_ns - simulated_ns
        late_ns = self._clock() - due_ns
        if late_ns < 0:
            self._sleep(-late_ns * 1e-9)
        self._lost_ns += max(0, late_ns - self._slack_ns)
