"""The halts of a chair: those of the present tick, the collision monitor's, and one that stays until it is reset."""

from __future__ import annotations

from collections.abc import Iterable

from waychair.control.safety.collision_monitor import SILENT_MS, MonitorVerdict, is_silent
from waychair.control.safety.stops import Halt, Severity, halt
from waychair.firmware_bridge.bridge import LATE_MS


class HaltWatch:
    """The state of one chair's halts; `present` holds those of the last tick."""

    def __init__(self) -> None:
        self.present: tuple[Halt, ...] = (halt("lidar_stale"),)
        self._latched: Halt | None = None
        self._ticked_ns, self._on_time_since_ns = 0, 0  # stamps of the last tick and of the first one since a gap

    @property
    def allow_driving(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return not any(halted.stop.severity is not Severity.PAUSES for halted in self.present)

    def update(
        self, now_ns: int, monitor: MonitorVerdict | None, found: Iterable[Halt], *, driven: bool
    ) -> tuple[Halt, ...]:
        """Return all halts of this tick: the ones `found`, the monitor's, and the latched one of the last drive.

        `driven`: whether the computer drove in the last tick; a grave halt latches only then.
        """
        self._note_tick_gap(now_ns)
        halts = [*found]
        can_judge = monitor is None or now_ns - self._on_time_since_ns > SILENT_MS * 1_000_000
        if can_judge and is_silent(monitor, now_ns):
            halts.append(halt("monitor_silent"))
        elif monitor is not None and monitor.stop:
            halts.append(halt(monitor.stop))
        if driven:
            latching = (halted for halted in halts if halted.stop.severity is Severity.LATCHES)
            self._latched = self._latched or next(latching, None)
        if self._latched is not None and self._latched not in halts:
            halts.append(self._latched)
        self.present = tuple(halts)
        return self.present

    def reset(self) -> None:
        """Forget the latched halt, by a person's deliberate act."""
        self._latched = None

    def _note_tick_gap(self, now_ns: int) -> None:
        """Note a gap between ticks (F17): a loop that was held up cannot tell whether the monitor was silent meanwhile.

        The command from before the gap is stale: by its age the bridge sends zero, then lets go.
        """
        if now_ns - self._ticked_ns > LATE_MS * 1_000_000:
            self._on_time_since_ns = now_ns
        self._ticked_ns = now_ns
