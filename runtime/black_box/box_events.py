"""The events that a black box keeps permanently: every stop, fault, jolt and pose jump, found in the ticks."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from waychair.control.drive.navigator import Stage
from waychair.control.safety.stops import STOPS, Severity
from waychair.control.safety.supervisor import DRIVEN
from waychair.runtime.black_box.box_file import LoggedHalt, LoggedLocalisation, Moment, Tick
from waychair.types import DriveMode, ImuSample


class Gravity(enum.Enum):
    """PAUSE: the chair stood and went on by itself; END: a drive ended or did not begin; FAULT: something broke."""

    PAUSE = "pause"
    END = "end"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class BlackBoxEvent:
    """An event at a tick: `id` of a row of `stops.STOPS` or of `OTHER_EVENTS`, with a plain sentence."""

    id: str
    text: str
    gravity: Gravity
    stamp_ns: int
    wall_ns: int


OTHER_EVENTS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "drive_failed": ("the drive was given up", "clear the way or choose another goal"),
        "pose_corrected": (
            "the chair found itself elsewhere on the map",
            "see whether the map shows it right, then ask for the goal again",
        ),
        "jolt": ("the chair was jolted, as by a knock", "look for what it touched, and for damage"),
        "program_ended": (
            "the program ended unexpectedly: it was killed, it crashed, or the power was cut",
            "see the system log of that minute, then restart it and ask for the goal again",
        ),
    }
)
"""Events outside the table of stops: sentence and remedy."""

_JOLT = 8.0  # m/s^2; horizontal acceleration above that of any drive: a knock
_JUMP = 0.5  # m; greatest correction of the pose at once that is no event

_SAME_PAUSE_NS = 2_000_000_000
"""A reason to pause that returns within this time counts as the same event."""

_SAME_JOLT_NS = 1_000_000_000
_SAME_END_NS = 500_000_000
"""Base and navigator in two processes report the end of one drive up to this time apart."""

_FAILED, _ENDED = Stage.FAILED.value, (Stage.FAILED.value, Stage.ARRIVED.value, Stage.IDLE.value)


class EventDetector:
    """Finds events by comparing each tick with the one before."""

    def __init__(self) -> None:
        self._drove = False
        self._stage = Stage.IDLE.value
        self._latched: frozenset[str] | None = None  # None until the first tick without a latched fault
        self._paused_ns: dict[str, int] = {}
        self._located: LoggedLocalisation | None = None
        self._jolted_ns: int | None = None
        self._ended_ns: int | None = None

    def update(self, moment: Moment) -> tuple[BlackBoxEvent, ...]:
        """Return the events of this tick, each id once."""
        tick = moment.tick
        found = [*self._end_once(tick), *self._faults(tick), *self._jumped(tick), *self._jolts(moment)]
        if tick.mode in DRIVEN:
            found += self._pauses(tick)
        self._drove, self._stage, self._located = tick.mode in DRIVEN, tick.stage, tick.located
        named = {event.id: event for event in reversed(found)}
        return tuple(event for event in found if named[event.id] is event)

    def _end_once(self, tick: Tick) -> list[BlackBoxEvent]:
        """Return the end of a drive, unless it was reported just before."""
        events = self._end_of_drive(tick)
        before_ns = self._ended_ns
        if events:
            self._ended_ns = tick.stamp_ns
        same = before_ns is not None and 0 <= tick.stamp_ns - before_ns < _SAME_END_NS and not self._drove
        return [] if same else events

    def _end_of_drive(self, tick: Tick) -> list[BlackBoxEvent]:
        """Return the event of a drive that ended before its goal, or was confirmed and did not begin."""
        drives = tick.mode in DRIVEN
        failed = tick.stage == _FAILED and (drives or self._stage not in _ENDED)
        over = not drives and (self._drove or failed)
        if over and tick.halt is not None:
            waits = tick.halt.id == "unconfirmed"  # another goal was asked for, or no yes came
            return [] if waits else [_event(tick, tick.halt)]
        if failed and (drives or self._drove):
            return [BlackBoxEvent("drive_failed", tick.stage_reason, Gravity.END, tick.stamp_ns, tick.wall_ns)]
        if over and tick.mode is DriveMode.STOPPED:
            return [_event(tick, LoggedHalt("stop_pressed", tick.reason))]
        return []

    def _faults(self, tick: Tick) -> list[BlackBoxEvent]:
        """Return new faults that need a reset."""
        now = {halted.id: halted for halted in tick.halts if _severity(halted) is Severity.LATCHES}
        before, fresh = self._latched, [] if self._latched is None else [n for n in now if n not in self._latched]
        if before is not None or not now:
            self._latched = frozenset(now)
        return [_event(tick, now[name]) for name in fresh]

    def _pauses(self, tick: Tick) -> list[BlackBoxEvent]:
        """Return new reasons to pause."""
        events = []
        for halted in tick.halts:
            if _severity(halted) is Severity.PAUSES:
                before_ns = self._paused_ns.get(halted.id)
                self._paused_ns[halted.id] = tick.stamp_ns
                if before_ns is None or not 0 <= tick.stamp_ns - before_ns <= _SAME_PAUSE_NS:
                    events.append(_event(tick, halted))
        return events

    def _jumped(self, tick: Tick) -> list[BlackBoxEvent]:
        """Return an event if the localiser corrected the pose by more than the limit at once."""
        before, now = self._located, tick.located
        if before is None or now is None or before == now:
            return []
        odom_from_base = now.map_from_odom.inverse() @ tick.map_from_base
        was = before.map_from_odom @ odom_from_base
        moved = math.hypot(was.x - tick.map_from_base.x, was.y - tick.map_from_base.y)
        if moved <= _JUMP:
            return []
        text = f"{OTHER_EVENTS['pose_corrected'][0]} ({moved:.1f} m away): {OTHER_EVENTS['pose_corrected'][1]}"
        return [BlackBoxEvent("pose_corrected", text, Gravity.FAULT, tick.stamp_ns, tick.wall_ns)]

    def _jolts(self, moment: Moment) -> list[BlackBoxEvent]:
        """Return an event if the IMU felt a knock; braking, and a tilt of 8 degrees, stay below the limit."""
        tick = moment.tick
        felt = [math.hypot(*message.accel[:2]) for message in moment.heard if isinstance(message, ImuSample)]
        hardest = max((value for value in felt if math.isfinite(value)), default=0.0)
        if hardest < _JOLT:
            return []
        before_ns, self._jolted_ns = self._jolted_ns, tick.stamp_ns
        if before_ns is not None and 0 <= tick.stamp_ns - before_ns < _SAME_JOLT_NS:
            return []
        text = f"{OTHER_EVENTS['jolt'][0]} ({hardest:.0f} m/s2): {OTHER_EVENTS['jolt'][1]}"
        return [BlackBoxEvent("jolt", text, Gravity.FAULT, tick.stamp_ns, tick.wall_ns)]


def _severity(halted: LoggedHalt) -> Severity | None:
    stop = STOPS.get(halted.id)
    return None if stop is None else stop.severity


def _event(tick: Tick, halted: LoggedHalt) -> BlackBoxEvent:
    by_severity = {Severity.PAUSES: Gravity.PAUSE, Severity.LATCHES: Gravity.FAULT}
    severity = _severity(halted)
    gravity = Gravity.END if severity is None else by_severity.get(severity, Gravity.END)
    return BlackBoxEvent(halted.id, halted.text, gravity, tick.stamp_ns, tick.wall_ns)
