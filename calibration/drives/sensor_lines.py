"""The text protocol of a real chair's sensors: lines that any microcontroller can print and people can read.

    wheels STAMP LEFT RIGHT                 encoder counts, forward positive
    imu STAMP AX AY AZ GX GY GZ             m/s^2, rad/s, axes as base (REP-145)
    scan STAMP ANGLE_MIN ANGLE_STEP TIME_STEP RANGE_MIN RANGE_MAX R0 R1 ...     rad, rad, s, m, m, m (REP-117)

A stamp is in nanoseconds of this computer's monotonic clock, or `-` for the arrival of the line; the transport delay
then counts as a part of the chair's delay.
"""

from __future__ import annotations

import numpy as np

from waychair.types import ImuSample, Scan, WheelTicks

LONGEST_LINE = 100_000
"""Greatest length of a line [bytes], enough for a scan of several thousand beams."""

_SHOWN = 60


def text_from_message(message: WheelTicks | ImuSample | Scan) -> str:
    """Return a message as a line with its stamp, without a line break."""
    if isinstance(message, WheelTicks):
        return f"wheels {message.stamp_ns} {message.left} {message.right}"
    if isinstance(message, ImuSample):
        values = " ".join(f"{float(value):.6g}" for value in (*message.accel, *message.gyro))
        return f"imu {message.stamp_ns} {values}"
    head = (message.angle_min, message.angle_step, message.time_step, message.range_min, message.range_max)
    ranges = " ".join(f"{float(value):.4f}" for value in message.ranges)
    return f"scan {message.stamp_ns} {' '.join(f'{value:.9g}' for value in head)} {ranges}"


def message_from_text(line: str, now_ns: int) -> WheelTicks | ImuSample | Scan | None:
    """Return the message of a line that arrived at `now_ns`; None for an invalid line."""
    kind, *words = line.split()
    try:
        stamp = now_ns if words[0] == "-" else int(words[0])
        if kind == "wheels":
            left, right = (int(word) for word in words[1:])
            return WheelTicks(stamp, left, right)
        values = np.array([float(word) for word in words[1:]])
    except (ValueError, IndexError):
        return None
    if kind == "imu" and len(values) == 6 and np.isfinite(values).all():
        return ImuSample(stamp, values[:3], values[3:])
    if kind == "scan" and len(values) > 6 and np.isfinite(values[:4]).all():
        angle_min, angle_step, time_step, range_min, range_max = values[:5].tolist()
        return Scan(
            stamp_ns=stamp,
            ranges=values[5:].astype(np.float32),
            angle_min=angle_min,
            angle_step=angle_step,
            time_step=time_step,
            range_min=range_min,
            range_max=range_max,
        )
    return None


class SensorLines:
    """Decodes messages from a stream of bytes. The first line is dropped, as it may be incomplete.

    `bad` counts the invalid lines; `last_bad` is the beginning of the last one.
    """

    def __init__(self) -> None:
        self.bad = 0
        self.last_bad = ""
        self._pending = b""
        self._begun = False

    def feed(self, data: bytes, now_ns: int) -> list[WheelTicks | ImuSample | Scan]:
        """Add bytes and return the completed messages, in order."""
        *ended, rest = (self._pending + data).split(b"\n")
        self._pending = rest[-LONGEST_LINE:]
        messages = []
        for raw in ended:
            line = raw.decode("ascii", "replace").strip()
            if not self._begun:
                self._begun = True
            elif line:
                message = message_from_text(line, now_ns)
                if message is None:
                    self.bad, self.last_bad = self.bad + 1, line[:_SHOWN]
                else:
                    messages.append(message)
        return messages
