"""How simulated time goes by: with the clock on the wall, as fast as it can, or one tick for each answer.

A simulation is a loop of ticks: what drives the chair is told what the sensors say, it sets the joystick lines, and the
simulator advances. A driver in the same process has answered whenever the loop comes round. A driver at the other end
of a cable has not: only `LOCKSTEP` then makes its runs repeatable.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from waychair.config import Settings, setting
from waychair.errors import DriverSilent


class PaceMode(enum.Enum):
    """What time waits for after each tick."""

    LOCKSTEP = "lockstep"  # the driver's answer, however long it takes within patience
    FAST = "fast"  # nothing
    REALTIME = "realtime"  # the clock on the wall


@dataclass(frozen=True, slots=True)
class PacingSettings(Settings):
    """Limits of patience."""

    patience: float = setting(
        5.0, "s", "lockstep: a driver that takes longer to answer has failed", low=0.01, high=3600
    )
    slack: float = setting(0.1, "s", "realtime: a delay beyond this is never caught up", low=0.0, high=10.0)


class Driver(Protocol):
    """What drives the chair from outside this process, such as the peer of a `PseudoTerminal`."""

    def wait(self, timeout_s: float) -> bool:
        """Whether its answer is there to be read, at the latest after `timeout_s`."""
        ...


class Pacer:
    """Holds back a simulation after each tick, and keeps account of how its time went by.

    In realtime, short delays are caught up; of a longer one only `slack` is, so that a machine that stumbles does not
    then rush. `lost_s` is what was given up so.
    """

    def __init__(
        self,
        mode: PaceMode = PaceMode.FAST,
        driver: Driver | None = None,
        settings: PacingSettings | None = None,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`driver` is the one that lockstep waits for; None is one in this process, which has answered already.

        `clock` gives nanoseconds that never step back.
        """
        self.mode = mode
        self._driver = driver
        self._settings = settings or PacingSettings()
        self._clock = clock
        self._sleep = sleep
        self._began: tuple[int, int] | None = None  # wall and simulated time of the first call
        self._now_ns = 0
        self._lost_ns = 0

    def pace(self, now_ns: int) -> None:
        """To be called with the simulated time [ns] after each tick; a call without a new time does nothing.

        Raises:
            DriverSilent: in lockstep, no answer came within patience; the answer itself is left to be read.
        """
        if self._began is None:
            self._began = self._clock(), now_ns
        elif now_ns <= self._now_ns:
            return
        self._now_ns = now_ns
        if self.mode is PaceMode.REALTIME:
            self._hold_to_the_wall()
        elif self.mode is PaceMode.LOCKSTEP and self._driver is not None:
            patience = self._settings.patience
            if not self._driver.wait(patience):
                raise DriverSilent(
                    f"the driver has not answered for {patience:g} s at {now_ns * 1e-9:.3f} s of simulated time; "
                    "start it, or take the mode fast or realtime"
                )

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second on the wall so far; 0 before any time has passed."""
        if self._began is None:
            return 0.0
        wall_ns = self._clock() - self._began[0]
        return (self._now_ns - self._began[1]) / wall_ns if wall_ns > 0 else 0.0

    @property
    def lost_s(self) -> float:
        """Seconds by which a realtime simulation fell behind for good; 0 when it held."""
        return self._lost_ns * 1e-9

    def _hold_to_the_wall(self) -> None:
        assert self._began is not None
        wall_ns, simulated_ns = self._began
        due_ns = wall_ns + self._lost_ns + self._now_ns - simulated_ns
        late_ns = self._clock() - due_ns
        if late_ns < 0:
            self._sleep(-late_ns * 1e-9)
        self._lost_ns += max(0, late_ns - round(self._settings.slack * 1e9))
