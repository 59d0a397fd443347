"""The collision monitor in a process of its own, so that neither a hanging planner nor a busy interpreter delays it.

A pair of datagram sockets connects it to the control loop: scans and commands go there, verdicts come back, each
message whole or not at all. Neither side waits: messages that do not fit into the socket's buffer are dropped, and a
dead monitor is noticed by the age of its last verdict. The process judges by its own timer, with or without a new
command, and ends with the control loop. All stamps are of CLOCK_MONOTONIC, which the processes of a computer share.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

import msgspec
import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.self_mask import SelfMask
from waychair.calibration.fits.stopping import StopTable
from waychair.control.safety.arc_clearance import MonitorSettings
from waychair.control.safety.collision_monitor import Monitor, MonitorVerdict
from waychair.firmware_bridge.heartbeat import urgent
from waychair.types import FloatArray, Scan, Twist

PERIOD_S = 0.02
"""Period of the process's verdicts."""

_LARGEST = 1 << 17  # bytes of a message: a scan of 10 000 beams is a third of it
_SCAN = struct.Struct("<cqddddd")
_COMMAND = struct.Struct("<cdddd")
_FURNITURE = struct.Struct("<cq")
_VERDICT = struct.Struct("<cqqdddd")
_PUSHES = struct.Struct("<cqdd8d")
_SHARES = struct.Struct("<cq?12d")
_NO_SCAN = -(2**63)


@dataclass(frozen=True, slots=True)
class Watched:
    """A chair's data for its monitor."""

    body: ChairBody = field(default_factory=lambda: CHAIR_A)
    settings: MonitorSettings = field(default_factory=MonitorSettings)
    stops: StopTable | None = None
    mask: SelfMask | None = None

    def monitor(self) -> Monitor:
        """Return a new monitor."""
        return Monitor(self.body, self.settings, self.stops, self.mask)


@dataclass(frozen=True, slots=True)
class MonitoredPushes:
    """The monitor's answer about pushes of the rider's stick at `stamp_ns`: the four twists, and the share of each that may
    be driven, None without a fit scan."""

    stamp_ns: int
    twists: tuple[Twist, ...]
    shares: tuple[float, ...] | None


class MonitorPort(Protocol):
    """The interface of a chair to its monitor, in the tick or in a process. `verdict` may be read from any thread."""

    @property
    def pushes(self) -> MonitoredPushes | None:
        """The latest answer to `judge_pushes`; None before the first."""

    def judge_pushes(self, twists: Sequence[Twist], measured: Twist, now_ns: int) -> None:
        """Ask about four pushes of the rider's own stick, with the measured twist."""

    @property
    def verdict(self) -> MonitorVerdict | None:
        """The latest verdict; None before the first."""

    def see(self, scan: Scan) -> None:
        """Pass on a raw scan."""

    def note_mapped_legs(self, mapped: FloatArray, stamp_ns: int) -> None:
        """Pass on points that look like legs but are on the map, (N, 2) [m] in the base frame of `stamp_ns`."""

    def judge(self, command: Twist, measured: Twist, now_ns: int) -> None:
        """Pass on the command that is about to be sent, and the measured twist."""

    def restart(self) -> None:
        """Restart a monitor that does not answer."""


class MonitorInStep:
    """The monitor as an object in the tick, for a chair on a simulator's clock: it judges when it is called."""

    def __init__(self, watched: Watched) -> None:
        self._watched = watched
        self._monitor = watched.monitor()
        self._verdict: MonitorVerdict | None = None
        self._pushes: MonitoredPushes | None = None

    @property
    def verdict(self) -> MonitorVerdict | None:
        """See `MonitorPort`."""
        return self._verdict

    @property
    def pushes(self) -> MonitoredPushes | None:
        """See `MonitorPort`."""
        return self._pushes

    def judge_pushes(self, twists: Sequence[Twist], measured: Twist, now_ns: int) -> None:
        """See `MonitorPort`."""
        self._pushes = MonitoredPushes(now_ns, tuple(twists), self._monitor.shares(twists, measured, now_ns))

    def see(self, scan: Scan) -> None:
        """See `MonitorPort`."""
        self._monitor.see(scan)

    def note_mapped_legs(self, mapped: FloatArray, stamp_ns: int) -> None:
        """See `MonitorPort`."""
        self._monitor.note_mapped_legs(mapped, stamp_ns)

    def judge(self, command: Twist, measured: Twist, now_ns: int) -> None:
        """See `MonitorPort`."""
        self._verdict = self._monitor.judge(command, measured, now_ns)

    def restart(self) -> None:
        """See `MonitorPort`."""
        self._monitor, self._verdict, self._pushes = self._watched.monitor(), None, None


class MonitorProcess:
    """Runs the monitor's process for as long as the block lasts; `pid` is its process id."""

    def __init__(self, watched: Watched) -> None:
        self._watched = watched
        self._lock = threading.Lock()
        self._verdict: MonitorVerdict | None = None
        self._pushes: MonitoredPushes | None = None
        self._socket, self._process = _started(watched)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._end()

    @property
    def pid(self) -> int:
        """Id of the present process."""
        return self._process.pid

    @property
    def verdict(self) -> MonitorVerdict | None:
        """See `MonitorPort`."""
        with self._lock:
            self._listen()
            return self._verdict

    @property
    def pushes(self) -> MonitoredPushes | None:
        """See `MonitorPort`."""
        with self._lock:
            self._listen()
            return self._pushes

    def judge_pushes(self, twists: Sequence[Twist], measured: Twist, now_ns: int) -> None:
        """See `MonitorPort`; the stamp is of CLOCK_MONOTONIC."""
        with self._lock:
            speeds = [speed for twist in twists for speed in (twist.v, twist.omega)]
            _send(self._socket, _PUSHES.pack(b"p", now_ns, measured.v, measured.omega, *speeds))

    def see(self, scan: Scan) -> None:
        """See `MonitorPort`."""
        with self._lock:
            _send(self._socket, _scan_message(scan))

    def note_mapped_legs(self, mapped: FloatArray, stamp_ns: int) -> None:
        """See `MonitorPort`; the stamp is of CLOCK_MONOTONIC."""
        with self._lock:
            _send(self._socket, _FURNITURE.pack(b"f", stamp_ns) + np.ascontiguousarray(mapped, "<f4").tobytes())

    def judge(self, command: Twist, measured: Twist, now_ns: int) -> None:
        """See `MonitorPort`; the process stamps its verdict itself."""
        with self._lock:
            _send(self._socket, _COMMAND.pack(b"c", command.v, command.omega, measured.v, measured.omega))

    def restart(self) -> None:
        """See `MonitorPort`."""
        with self._lock:
            self._end()
            self._verdict = self._pushes = None
            self._socket, self._process = _started(self._watched)

    def _listen(self) -> None:
        for message in _received(self._socket):
            if message[:1] == b"p":
                self._pushes = _shares_from(message)
            else:
                self._verdict = _verdict_from(message)

    def _end(self) -> None:
        self._socket.close()
        self._process.kill()  # SIGKILL also ends a stopped process; it has nothing to save
        self._process.wait()


def _started(watched: Watched) -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """Start the process; return our end of the channel and the process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    told = msgspec.json.encode(watched).decode()
    command = [sys.executable, "-m", "waychair.runtime.monitor_process", str(theirs.fileno()), told]
    with theirs:
        return ours, subprocess.Popen(command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)


def watch(channel: socket.socket, monitor: Monitor) -> None:
    """Run the process: take in messages and judge by the timer, until the other side is gone."""
    channel.setblocking(False)
    command, measured = Twist(), Twist()
    due_s = time.monotonic()
    while True:
        select.select([channel], [], [], max(due_s - time.monotonic(), 0.0))
        for message in _received(channel):
            if message[:1] == b"s":
                monitor.see(_scan_from(message))
            elif message[:1] == b"f":
                _, stamp_ns = _FURNITURE.unpack_from(message)
                mapped = np.frombuffer(message, "<f4", offset=_FURNITURE.size).astype(np.float64)
                monitor.note_mapped_legs(mapped.reshape(-1, 2), stamp_ns)
            elif message[:1] == b"p":
                if not _send(channel, _answer(monitor, message)):
                    return
            else:
                _, v, omega, v_now, omega_now = _COMMAND.unpack(message)
                command, measured = Twist(v, omega), Twist(v_now, omega_now)
        if time.monotonic() >= due_s:
            due_s = max(due_s + PERIOD_S, time.monotonic())
            if not _send(channel, _verdict_message(monitor.judge(command, measured, time.monotonic_ns()))):
                return


def _received(channel: socket.socket) -> Iterator[bytes]:
    """Yield all waiting messages."""
    with contextlib.suppress(OSError):  # no message is left, or the other side is gone
        while True:
            yield channel.recv(_LARGEST)


def _send(channel: socket.socket, message: bytes) -> bool:
    """Send a message, or drop it if the buffer is full; return False if the other side is gone."""
    try:
        channel.send(message)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return True


def _scan_message(scan: Scan) -> bytes:
    head = _SCAN.pack(
        b"s", scan.stamp_ns, scan.angle_min, scan.angle_step, scan.time_step, scan.range_min, scan.range_max
    )
    return head + np.ascontiguousarray(scan.ranges, "<f4").tobytes()


def _scan_from(message: bytes) -> Scan:
    _, stamp_ns, *figures = _SCAN.unpack_from(message)
    return Scan(stamp_ns, np.frombuffer(message, "<f4", offset=_SCAN.size), *figures)


def _verdict_message(verdict: MonitorVerdict) -> bytes:
    scan_ns = _NO_SCAN if verdict.scan_ns is None else verdict.scan_ns
    twist = verdict.twist
    head = _VERDICT.pack(b"v", verdict.stamp_ns, scan_ns, twist.v, twist.omega, verdict.share, verdict.contact_s)
    return head + verdict.stop.encode()


def _verdict_from(message: bytes) -> MonitorVerdict:
    _, stamp_ns, scan_ns, v, omega, share, contact_s = _VERDICT.unpack_from(message)
    seen_ns = None if scan_ns == _NO_SCAN else scan_ns
    return MonitorVerdict(
        stamp_ns=stamp_ns,
        scan_ns=seen_ns,
        twist=Twist(v, omega),
        share=share,
        contact_s=contact_s,
        stop=message[_VERDICT.size :].decode(),
    )


def _answer(monitor: Monitor, message: bytes) -> bytes:
    """Return the monitor's shares of the pushes in a message."""
    _, stamp_ns, v, omega, *speeds = _PUSHES.unpack(message)
    shares = monitor.shares(_twists(speeds), Twist(v, omega), time.monotonic_ns())
    return _SHARES.pack(b"p", stamp_ns, shares is not None, *speeds, *(shares or (0.0,) * 4))


def _shares_from(message: bytes) -> MonitoredPushes:
    _, stamp_ns, fit, *figures = _SHARES.unpack(message)
    return MonitoredPushes(stamp_ns, _twists(figures[:8]), tuple(figures[8:]) if fit else None)


def _twists(speeds: Sequence[float]) -> tuple[Twist, ...]:
    return tuple(Twist(v, omega) for v, omega in zip(speeds[::2], speeds[1::2], strict=True))


def main() -> None:
    """Watch over the chair that the second argument describes, over the socket whose descriptor is the first."""
    channel = socket.socket(fileno=int(sys.argv[1]))
    urgent()
    watch(channel, msgspec.json.decode(sys.argv[2], type=Watched).monitor())


if __name__ == "__main__":
    main()
