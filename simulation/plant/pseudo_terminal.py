"""A serial cable without hardware: the far end is a device file that any program opens as a serial port.

It is a pseudo-terminal pair in raw mode (termios(3), pty(7)). As with a cable, a program may open the far end, go away
and come back; bytes sent while the far end is closed are lost.
"""

from __future__ import annotations

import errno
import os
import select
import termios
import time
import tty
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.errors import OutputError

CAPACITY = 1 << 16
"""Bytes that may wait for a slow reader, besides a few thousand in the kernel; more are refused."""

_READ_AT_ONCE = 1 << 16
_POLL_PAUSE_S = 0.005  # poll(2) returns at once while the far end is closed


class PseudoTerminal:
    """The near end of the cable; only `wait` blocks.

        with PseudoTerminal(link=Path("out/chair")) as cable:
            cable.write(b"...")
            if cable.wait(0.1):
                answer = cable.read()

    Raises:
        OutputError: this system has no pseudo-terminals left, or the link cannot be made.
    """

    def __init__(self, link: Path | None = None) -> None:
        """`link` is a path for the far end that is the same in every run."""
        try:
            self._near, far = os.openpty()
        except OSError as error:
            raise OutputError(f"no pseudo-terminal can be opened: {error.strerror}; close some terminals") from error
        self._device = Path(os.ttyname(far))
        tty.setraw(far)
        os.close(far)  # so that a hang-up by the last program at the far end is seen
        os.set_blocking(self._near, False)
        self._poll = select.poll()
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._link: Path | None = None
        if link is not None:
            try:
                make_link(link, self._device)
            except OutputError:
                os.close(self._near)
                raise
            self._link = link

    @property
    def path(self) -> Path:
        """The path that the other program opens."""
        return self._link or self._device

    @property
    def connected(self) -> bool:
        """Whether a program has the far end open."""
        return not self._events(select.POLLIN, 0.0) & select.POLLHUP

    def write(self, data: bytes) -> int:
        """Send bytes; return how many were accepted, fewer than all only if the reader lags far behind.

        While the far end is closed, all bytes are accepted and lost.
        """
        if not self.connected:
            self._discard_queued()
            return len(data)
        taken = data[: CAPACITY - self._waiting_bytes]
        if taken:
            self._waiting.append(taken)
            self._waiting_bytes += len(taken)
        self._send()
        return len(taken)

    def read(self) -> bytes:
        """Return the bytes received since the last call, up to 64 KiB; empty if there are none."""
        self._send()
        parts, room = [], _READ_AT_ONCE
        while room > 0:
            try:
                part = os.read(self._near, room)
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno != errno.EIO:  # EIO: the far end is closed and all its bytes were read
                    raise
                break
            parts.append(part)
            room -= len(part)
        return b"".join(parts)

    def wait(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` for bytes, sending queued bytes meanwhile; return whether bytes can be read."""
        deadline = time.monotonic() + timeout_s
        while True:
            self._send()
            left = max(0.0, deadline - time.monotonic())
            seen = self._events(select.POLLIN | (select.POLLOUT if self._waiting else 0), left)
            if seen & select.POLLIN:
                return True
            if time.monotonic() >= deadline:
                return False
            if seen & select.POLLHUP:
                time.sleep(min(left, _POLL_PAUSE_S))

    def close(self) -> None:
        """Hang up and remove the link; may be called again."""
        if self._near < 0:
            return
        os.close(self._near)
        self._near = -1
        if self._link is not None and self._link.is_symlink() and self._link.readlink() == self._device:
            self._link.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _events(self, wanted: int, timeout_s: float) -> int:
        self._poll.register(self._near, wanted)
        return next((seen for _, seen in self._poll.poll(timeout_s * 1000.0)), 0)

    def _send(self) -> None:
        """Send as many of the queued bytes as the kernel takes."""
        while self._waiting:
            try:
                sent = os.write(self._near, self._waiting[0])
            except BlockingIOError:
                return
            self._waiting_bytes -= sent
            if sent == len(self._waiting[0]):
                self._waiting.popleft()
            else:
                self._waiting[0] = self._waiting[0][sent:]

    def _discard_queued(self) -> None:
        """Discard all queued bytes, so that the next program at the far end does not read them."""
        self._waiting.clear()
        self._waiting_bytes = 0
        termios.tcflush(self._near, termios.TCOFLUSH)  # bytes in transit
        far = os.open(self._device, os.O_RDWR | os.O_NOCTTY)
        try:
            termios.tcflush(far, termios.TCIFLUSH)  # bytes that arrived
        finally:
            os.close(far)


def make_link(link: Path, device: Path) -> None:
    """Make a symbolic link to the device; a link to a device that is gone is replaced.

    Raises:
        OutputError: the name is taken by something else, or the link cannot be made.
    """
    if link.is_symlink() and not link.exists():
        link.unlink()
    if link.is_symlink() or link.exists():
        raise OutputError(f"{link} exists already; remove it if nothing runs there, or choose another name")
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(device)
    except OSError as error:
        raise OutputError(f"cannot make the link {link}: {error.strerror}; choose another folder") from error
