"""A serial cable without hardware: the far end is a device file that any program opens as a serial port.

It is a pseudo-terminal pair in raw mode (termios(3), pty(7)). As with a cable, a program may open the far end, vanish
and come back; bytes that are sent while nobody is there are lost.
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
"""Bytes that wait for a slow reader before more are refused, besides a few thousand in the kernel."""

_READ_AT_ONCE = 1 << 16
_LOOK_AGAIN_S = 0.005  # poll(2) returns at once while nobody has the far end open


class PseudoTerminal:
    """The near end of the cable; nothing here ever blocks but `wait`.

        with PseudoTerminal(link=Path("out/chair")) as cable:
            cable.write(b"...")
            if cable.wait(0.1):
                answer = cable.read()

    Raises:
        OutputError: this system has no pseudo-terminals left, or the link cannot be made.
    """

    def __init__(self, link: Path | None = None) -> None:
        """`link` is a name for the far end that stays the same from run to run."""
        try:
            self._near, far = os.openpty()
        except OSError as error:
            raise OutputError(f"no pseudo-terminal can be opened: {error.strerror}; close some terminals") from error
        self._device = Path(os.ttyname(far))
        tty.setraw(far)
        os.close(far)  # so that a hang-up of the last one who has it open is seen
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
        """What the other program opens."""
        return self._link or self._device

    @property
    def connected(self) -> bool:
        """Whether somebody has the far end open."""
        return not self._events(select.POLLIN, 0.0) & select.POLLHUP

    def write(self, data: bytes) -> int:
        """Sends bytes; how many of them were taken, which is fewer than all only when the reader lags far behind.

        While nobody has the far end open all are taken, and lost.
        """
        if not self.connected:
            self._forget()
            return len(data)
        taken = data[: CAPACITY - self._waiting_bytes]
        if taken:
            self._waiting.append(taken)
            self._waiting_bytes += len(taken)
        self._send()
        return len(taken)

    def read(self) -> bytes:
        """What has come since the last call, up to 64 KiB; empty when there is nothing."""
        self._send()
        parts, room = [], _READ_AT_ONCE
        while room > 0:
            try:
                part = os.read(self._near, room)
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno != errno.EIO:  # nobody is there, and what they sent before has been read
                    raise
                break
            parts.append(part)
            room -= len(part)
        return b"".join(parts)

    def wait(self, timeout_s: float) -> bool:
        """Whether bytes are there to be read, at the latest after `timeout_s`; what waits to be sent goes meanwhile."""
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
                time.sleep(min(left, _LOOK_AGAIN_S))

    def close(self) -> None:
        """Hangs up and removes the link; may be called again."""
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
        """As much of what waits as the kernel takes."""
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

    def _forget(self) -> None:
        """Nobody who comes later shall read what was meant for the one who left."""
        self._waiting.clear()
        self._waiting_bytes = 0
        termios.tcflush(self._near, termios.TCOFLUSH)  # what is on its way
        far = os.open(self._device, os.O_RDWR | os.O_NOCTTY)
        try:
            termios.tcflush(far, termios.TCIFLUSH)  # what has arrived
        finally:
            os.close(far)


def make_link(link: Path, device: Path) -> None:
    """A symbolic link to the device; one whose device is gone is replaced.

    Raises:
        OutputError: there is something else of that name, or the link cannot be made.
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
