"""Evidence for the reason of a stop from the log: figures in plain sentences, one function for each kind of reason."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec
import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.drive.navigator import Stage
from waychair.control.safety.collision_monitor import points_now, valid_beams
from waychair.control.safety.stops import STOPS
from waychair.control.safety.supervisor import DRIVEN, SupervisorSettings
from waychair.errors import BoxError, WaychairError
from waychair.runtime.black_box.box_file import Log, Tick
from waychair.types import ChairStatus, FloatArray, ImuSample, RgbdFrame, Scan, WheelTicks
from waychair.yaml_files import yaml_from_text

_M = TypeVar("_M")
_A_MOMENT_NS = 500_000_000


@dataclass(frozen=True, slots=True)
class LogCursor:
    """A log with the index of one of its ticks."""

    log: Log
    index: int

    @property
    def tick(self) -> Tick:
        """The tick at the index."""
        return self.log.moments[self.index].tick

    def latest(self, kind: type[_M]) -> _M | None:
        """Return the latest message of a type; None without one."""
        for moment in reversed(self.log.moments[: self.index + 1]):
            for message in reversed(moment.heard):
                if isinstance(message, kind):
                    return message
        return None

    def recent(self, ns: int = _A_MOMENT_NS) -> list[Tick]:
        """Return the ticks of the last `ns` nanoseconds, up to this one."""
        until_ns = self.tick.stamp_ns
        return [tick for tick in self.log.ticks[: self.index + 1] if until_ns - tick.stamp_ns <= ns]

    def calibration(self) -> ChairCalibration:
        """Return the chair's calibration, or the default one if this version cannot read it."""
        try:
            return msgspec.convert(self.log.head.calibration, ChairCalibration)
        except (msgspec.ValidationError, WaychairError):
            return ChairCalibration("", "")

    def setting(self, *path: str, default: float) -> float:
        """Return a figure of the logged configuration, or the default."""
        try:
            value: Any = yaml_from_text(self.log.head.configuration, "the configuration", BoxError)
            for name in path:
                value = value[name]
            return float(value)
        except (BoxError, KeyError, TypeError, ValueError):
            return default


def evidence(cursor: LogCursor, stop_id: str) -> tuple[str, ...]:
    """Return the sentences of evidence for a reason."""
    name = "board" if stop_id.startswith("board_") else stop_id
    return tuple(sentence for sentence in _SHOWN.get(name, _nothing)(cursor) if sentence)


def nearest_obstacle(cursor: LogCursor) -> str:
    """Return a sentence about the nearest point of the last scan in the driving direction, or else anywhere."""
    scan, tick = cursor.latest(Scan), cursor.tick
    if scan is None:
        return ""
    calibration = cursor.calibration()
    body, seen = calibration.body, calibration.masked(scan)
    told = valid_beams(seen, np.zeros(len(seen.ranges), np.bool_))
    points = points_now(seen, told, body, tick.twist, tick.stamp_ns)
    if not len(points):
        return "the last scan shows nothing"
    beyond = np.maximum(points[:, 0] - body.front, -body.rear - points[:, 0])
    beside = np.abs(points[:, 1]) - body.width / 2
    gaps = np.hypot(np.maximum(beyond, 0.0), np.maximum(beside, 0.0))
    on_the_way = _on_the_way(points, tick, body.width)
    among = np.where(on_the_way, gaps, np.inf) if on_the_way.any() else gaps
    index = int(np.argmin(among))
    x, y = points[index]
    bearing = math.degrees(math.atan2(y, x - body.laser_x))
    where = "ahead" if abs(bearing) < 60 else "behind" if abs(bearing) > 120 else "beside it"
    side = "" if abs(y) < 0.1 else f", {abs(y):.2f} m to the {'left' if y > 0 else 'right'} of its middle"
    return f"the nearest object that the lidar saw was {gaps[index]:.2f} m from the chair, {where}{side}"


def _on_the_way(points: FloatArray, tick: Tick, width: float) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return (N,) whether points lie in the driving direction, no more than the chair's width aside."""
    backwards = (tick.asked.v or tick.twist.v) < 0.0
    towards = -points[:, 0] if backwards else points[:, 0]
    ahead: np.ndarray[Any, np.dtype[np.bool_]] = (towards > 0.0) & (np.abs(points[:, 1]) < width)
    return ahead


def _age(kind: type[Scan | WheelTicks | ImuSample | RgbdFrame | ChairStatus], what: str) -> _Shown:
    def shown(cursor: LogCursor) -> tuple[str, ...]:
        message = cursor.latest(kind)
        if message is None:
            return (f"no {what} is in the log",)
        return (f"the last {what} was {(cursor.tick.stamp_ns - message.stamp_ns) * 1e-9:.2f} s old",)

    return shown


def _nothing(cursor: LogCursor) -> tuple[str, ...]:
    return ()


def _coverage(cursor: LogCursor) -> tuple[str, ...]:
    scan = cursor.latest(Scan)
    if scan is None or not len(scan.ranges):
        return ("no scan is in the log",)
    return (f"{100 * np.isfinite(scan.ranges).mean():.0f} % of the last scan's beams measured something",)


def _repeated(cursor: LogCursor) -> tuple[str, ...]:
    scans = [
        message
        for moment in cursor.log.moments[: cursor.index + 1]
        for message in moment.heard
        if isinstance(message, Scan)
    ]
    same = 0
    for before, after in zip(scans[-2::-1], scans[:0:-1], strict=True):
        if not np.array_equal(before.ranges, after.ranges, equal_nan=True):
            break
        same += 1
    return (f"the last {same + 1} scans were identical",)


def _obstacle(cursor: LogCursor) -> tuple[str, ...]:
    tick = cursor.tick
    return nearest_obstacle(
        cursor
    ), f"the requested speed was {tick.asked.v:.2f} m/s, the measured one {tick.twist.v:.2f} m/s"


def _place(cursor: LogCursor) -> tuple[str, ...]:
    located = cursor.tick.located
    if located is None:
        return ("the localiser had not reported a pose yet",)
    away = math.hypot(located.remaining.x, located.remaining.y)
    fits = f"the pose was right with a probability of {100 * located.health:.0f} %"
    return (
        f"{fits}, and {100 * located.inliers:.0f} % of the scan lay on the map's walls",
        f"by the scans the chair was {away:.2f} m from its assumed pose" if away > 0.05 else "",
    )


def _stick(cursor: LogCursor) -> tuple[str, ...]:
    sticks = [tick.telemetry.joystick for tick in cursor.recent() if tick.telemetry is not None]
    if not sticks:
        return ("the board did not report the joystick",)
    most = max(sticks, key=lambda stick: max(abs(stick.forward), abs(stick.turn)))
    limit = cursor.setting("supervisor", "override", default=SupervisorSettings().override)
    way = "forward" if most.forward >= 0 else "back"
    side = "to the left" if most.turn >= 0 else "to the right"
    pushed = f"{abs(most.forward):.2f} {way} and {abs(most.turn):.2f} {side}"
    return (f"the joystick was pushed {pushed} (full deflection is 1); {limit:.2f} takes over",)


def _asked_for(cursor: LogCursor) -> tuple[str, ...]:
    for index, told in reversed(cursor.log.requests):
        if told.what == "stop" and index <= cursor.index:
            return (f"Stop came {_clock(cursor, index)}",)
    return ()


def _clock(cursor: LogCursor, index: int) -> str:
    seconds = (cursor.log.moments[index].tick.stamp_ns - cursor.tick.stamp_ns) * 1e-9
    return "in that tick" if abs(seconds) < 0.06 else f"{seconds:+.2f} s from that tick"


def _disobeys(cursor: LogCursor) -> tuple[str, ...]:
    tick = cursor.tick
    told, moved = (f"{each.v:.2f} m/s and {each.omega:.2f} rad/s" for each in (tick.command or tick.asked, tick.twist))
    return (f"the command was {told}, the measured motion {moved}",)


def _board(cursor: LogCursor) -> tuple[str, ...]:
    """Return the board's last report, and the line voltages beside those that were sent."""
    ticks = cursor.log.ticks[: cursor.index + 1]
    reported = next((tick for tick in reversed(ticks) if tick.telemetry is not None), None)
    if reported is None or reported.telemetry is None:
        return ("the log holds no report of the board",)
    telemetry, sent = reported.telemetry, reported.sent
    age_s = (cursor.tick.stamp_ns - telemetry.stamp_ns) * 1e-9
    faults = f", with {', '.join(telemetry.faults)}" if telemetry.faults else ""
    read, told = (f"{each.forward_volts:.2f} V and {each.turn_volts:.2f} V" for each in (telemetry, sent))
    return (
        f"the board's last report was {age_s:.2f} s old: {telemetry.state}{faults}, lines held by {telemetry.holder}",
        f"the lines read {read}; {told} were sent",
    )


def _lean(cursor: LogCursor) -> tuple[str, ...]:
    samples = [
        message.accel
        for moment in cursor.log.moments[max(0, cursor.index - 9) : cursor.index + 1]
        for message in moment.heard
        if isinstance(message, ImuSample)
    ]
    if not samples:
        return ("the log holds no IMU sample",)
    x, y, z = np.mean(samples, axis=0)
    return (
        f"by the IMU's mean over half a second the chair was tilted by {math.degrees(math.atan2(math.hypot(x, y), z)):.0f} degrees",
    )


def _contacts(cursor: LogCursor) -> tuple[str, ...]:
    moments = cursor.log.moments[: cursor.index + 1]
    said = [message for moment in moments for message in moment.heard if isinstance(message, ChairStatus)]
    if not said:
        return ("the log holds no report of the chair's contacts",)
    words = {None: "not known", True: "yes", False: "no"}
    seated, charging, battery = (
        next((value for status in reversed(said) if (value := getattr(status, name)) is not None), None)
        for name in ("seated", "charging", "battery")
    )
    charge = "not known" if battery is None else f"{100 * battery:.0f} %"
    return (f"somebody seated: {words[seated]}; charger connected: {words[charging]}; battery: {charge}",)


def _given_up(cursor: LogCursor) -> tuple[str, ...]:
    """Return the waiting time, the number of plans, and the nearest obstacle."""
    waits = {Stage.WAITING.value, Stage.OFFERING.value, Stage.FAILED.value}
    since = cursor.index
    while since > 0 and cursor.log.moments[since - 1].tick.stage in waits:
        since -= 1
    waited_s = (cursor.tick.stamp_ns - cursor.log.moments[since].tick.stamp_ns) * 1e-9
    plans = cursor.tick.plans
    return (
        f"the drive had waited for {waited_s:.1f} s" if waited_s > 0.1 else "",
        f"the navigator had planned {plans} path{'s' if plans != 1 else ''}",
        nearest_obstacle(cursor),
    )


def _silent_monitor(cursor: LogCursor) -> tuple[str, ...]:
    since = cursor.index
    while since > 0 and any(h.id == "monitor_silent" for h in cursor.log.moments[since - 1].tick.halts):
        since -= 1
    seconds = (cursor.tick.stamp_ns - cursor.log.moments[since].tick.stamp_ns) * 1e-9
    return (f"it had been silent for {seconds:.1f} s beyond its limit",)


def _last_tick(cursor: LogCursor) -> tuple[str, ...]:
    tick = cursor.tick
    moves = abs(tick.twist.v) > 0.02 or abs(tick.twist.omega) > 0.05
    drives = tick.mode in DRIVEN and tick.sent.active
    motion, holder = "moved" if moves else "stood", "computer" if drives else "rider"
    return (f"in the last tick of the log the chair {motion}, and the {holder} had the lines",)


_Shown = Callable[[LogCursor], tuple[str, ...]]

_SHOWN: Mapping[str, _Shown] = MappingProxyType(
    {
        "stop_pressed": _asked_for,
        "taken_over": _stick,
        "seat_empty": _contacts,
        "charging": _contacts,
        "battery_low": _contacts,
        "status_stale": _age(ChairStatus, "contact report"),
        "lidar_stale": _age(Scan, "scan"),
        "lidar_late": _age(Scan, "scan"),
        "lidar_slow": _age(Scan, "scan"),
        "lidar_delayed": _age(Scan, "scan"),
        "lidar_clock": _age(Scan, "scan"),
        "lidar_blind": _coverage,
        "lidar_frozen": _repeated,
        "wheels_stale": _age(WheelTicks, "wheel reading"),
        "wheels_delayed": _age(WheelTicks, "wheel reading"),
        "stick_off_rest": _stick,
        "imu_stale": _age(ImuSample, "IMU sample"),
        "depth_stale": _age(RgbdFrame, "picture"),
        "obstacle": _obstacle,
        "own_parts": _obstacle,
        "monitor_silent": _silent_monitor,
        "lost": _place,
        "unplaced": _place,
        "pose_jump": _place,
        "pose_corrected": _place,
        "tilt": _lean,
        "disobeys": _disobeys,
        "board": _board,
        "board_estop": _board,
        "drive_failed": _given_up,
        "jolt": _obstacle,
        "program_ended": _last_tick,
    }
)

LOOK_AT: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "lidar": ("the lidar's cable, power and window", "its scans just before"),
        "wheels": ("the encoders' cable", "the readings of the wheels just before"),
        "imu": ("the IMU's cable",),
        "depth": ("the camera's cable",),
        "status": ("the cable of the contacts",),
        "obstacle": ("the last scan, for the obstacle: legs, a trolley, glass, the rider's own feet",),
        "own": ("the last scan beside the chair's outline",),
        "near": ("the last scan beside the chair's outline",),
        "monitor": ("the processor load of that minute, and whether the monitor's process was killed",),
        "lost": (
            "the map beside the scans: has much been moved?",
            "whether the wheels slipped or the chair was carried",
        ),
        "unplaced": ("whether the chair was moved while its computer was off", "the map beside the scans"),
        "pose": ("the map beside the scans: do two places look alike?",),
        "navigator": ("whether the navigator's process was killed, and the processor load of that minute",),
        "localiser": ("whether the localiser's process was killed, and the processor load of that minute",),
        "two": ("which programs publish speeds for this chair",),
        "tilt": ("the floor there, and how the IMU is mounted",),
        "disobeys": ("the chair's speed dial, its brake levers, and anything that may block it",),
        "board": ("the board's cable and power, and the wiring of the joystick lines",),
        "computer": ("the processor load of that minute",),
        "stick": ("things that press on the joystick, and its volts at rest",),
        "never": ("the board's state in the log, and the joystick's volts at rest",),
        "taken": ("nothing, if the rider meant it; otherwise things that press on the joystick",),
        "stop": ("nothing, if it was intended",),
        "seat": ("the seat switch",),
        "charging": ("the charger's plug",),
        "battery": ("the battery",),
        "drive": ("the obstacle, and whether the map is still right there",),
        "jolt": ("the thing that the chair touched",),
        "program": ("the system log of that minute, for lack of memory or power",),
    }
)
"""Hints for the search for the cause, by the first word of a reason's id."""


def look_at(stop_id: str) -> tuple[str, ...]:
    """Return the hints for a reason."""
    return LOOK_AT.get(stop_id.split("_")[0], ())


def remedy_of(stop_id: str, text: str) -> str:
    """Return the remedy from the table of stops, or the text after the last colon."""
    stop = STOPS.get(stop_id)
    if stop is not None:
        return stop.remedy
    return text.rpartition(": ")[2]
