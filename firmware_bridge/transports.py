"""Transports of bytes to the board and back: a serial line, TCP or a pseudo-terminal behind one interface.

No call waits longer than one command period. A cable may be pulled at any moment, so an open transport raises no error:
after it lost its other end, `closed` is true, writes fail and reads are empty. `Reconnecting` opens it again.
"""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import select
import socket
import stat
import termios
import threading
import time
import tty
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Protocol

from waychair.errors import TransportError
from waychair.install_advice import pip_install

WRITE_TIMEOUT_S = 0.02
"""One command period. pyserial waits for ever with None and, on a full line, also with 0."""

READ_MAX = 4096

_TCP_PORTS = range(1, 65_536)


class Transport(Protocol):
    """A cable to the board."""

    def write(self, data: bytes) -> bool:
        """Send all bytes within one command period; return whether it could. On failure some bytes may be lost."""

    def read(self) -> bytes:
        """Return the bytes that have arrived, possibly none."""

    def fileno(self) -> int:
        """Return the descriptor for `select`; -1 once closed, also while another thread is closing it."""

    @property
    def closed(self) -> bool:
        """Whether the other end is gone."""

    def close(self) -> None:
        """Close the transport; may be called again."""


class SerialTransport:
    """A serial port by pyserial: 115200 baud, 8 data bits, no parity, one stop bit, exclusive."""

    def __init__(self, path: str, baud: int = 115_200) -> None:
        """
        Raises:
            TransportError: there is no such port, this user has no right to it, another program has it, it is no serial
                port, or pyserial is not installed.
        """
        try:
            import serial
        except ImportError as error:
            raise TransportError(f"a serial port needs pyserial: install it with `{pip_install()} pyserial`") from error
        # A device that is removed also raises termios.error; a port that another thread closes has the descriptor None.
        self._failures = (OSError, ValueError, TypeError, termios.error, serial.SerialException)
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except self._failures as error:
            raise TransportError(unopened_port(path, getattr(error, "errno", None), str(error))) from error
        self._timeout = serial.SerialTimeoutException

    @property
    def closed(self) -> bool:
        return not self._port.is_open

    def fileno(self) -> int:
        with contextlib.suppress(*self._failures):
            return int(self._port.fileno())
        return -1

    def write(self, data: bytes) -> bool:
        if self.closed:
            return False
        try:
            return bool(self._port.write(data) == len(data))
        except self._timeout:
            return False  # full, not lost
        except self._failures:
            self.close()
            return False

    def read(self) -> bytes:
        if self.closed:
            return b""
        try:
            return bytes(self._port.read(READ_MAX))
        except self._failures:
            self.close()
            return b""

    def close(self) -> None:
        with contextlib.suppress(*self._failures):
            self._port.close()


def unopened_port(path: str, number: int | None, text: str) -> str:
    """Return the sentence about a serial port that cannot be opened, from the error's number and text."""
    if number in _MISSING:
        there = sorted(str(each) for kind in _PORTS for each in Path("/dev").glob(kind))
        found = f" (there are {', '.join(there)})" if there else ""
        return f"there is no serial port {path}{found}: plug the board in, or name the port that it has"
    if number in (errno.EACCES, errno.EPERM):
        return (
            f"the serial port {path} is there, but this user may not open it: run `sudo usermod -aG {_port_group(path)} "
            "$USER`, then log out and in again"
        )
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"the serial port {path} is in use by {_holder(path)}: end that program first"
    if number == errno.EISDIR or not Path(path).is_char_device():
        return f"{path} is no serial port: name a port such as /dev/ttyUSB0"
    return f"cannot open the serial port {path}: {text}; unplug the board and plug it in again"


_MISSING = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR)

_PORTS = ("ttyUSB*", "ttyACM*")
"""Names under /dev of the ports of USB boards."""

_USUAL_GROUP = "dialout"
"""The group of serial ports on Debian and Ubuntu; elsewhere it is uucp or plugdev, for instance."""


def _port_group(path: str) -> str:
    """Return the group that may open a port, or the usual group where the port's own would not help."""
    try:
        found = Path(path).stat()
        group = grp.getgrgid(found.st_gid).gr_name
    except (OSError, KeyError):
        return _USUAL_GROUP
    both = stat.S_IRGRP | stat.S_IWGRP
    return group if found.st_mode & both == both and found.st_gid != 0 else _USUAL_GROUP


def _holder(path: str) -> str:
    """Return the program that has a port open, by proc(5); programs of other users are not seen."""
    port = Path(path).resolve()
    for held in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            if held.readlink() == port and held.parts[2] != str(os.getpid()):
                name = (held.parents[1] / "comm").read_text(encoding="utf-8", errors="replace").strip()
                return f"'{name}' (process {held.parts[2]})"
    return "another program"


def is_pseudo_terminal(path: str) -> bool:
    """Return whether a port leads to a program on this computer (pts(4)), such as a simulated board; a link is followed."""
    return Path(path).resolve().parent == Path("/dev/pts")


class TcpTransport:
    """A TCP connection, for tests and for boards behind a network bridge in the workshop; never for a rider."""

    def __init__(self, host: str, port: int, timeout_s: float = 2.0) -> None:
        """
        Raises:
            TransportError: the address does not answer.
        """
        try:
            self._socket: socket.socket | None = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise TransportError(f"cannot connect to {host}:{port}: {error}; is the board's bridge running?") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(WRITE_TIMEOUT_S)

    @property
    def closed(self) -> bool:
        return self._socket is None

    def fileno(self) -> int:
        connected = self._socket  # another thread may be closing it
        return -1 if connected is None else connected.fileno()

    def write(self, data: bytes) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.sendall(data)
        except TimeoutError:
            return False
        except OSError:
            self.close()
            return False
        return True

    def read(self) -> bytes:
        if self._socket is None:
            return b""
        ready, _, _ = select.select([self._socket], [], [], 0)
        if not ready:
            return b""
        try:
            data = self._socket.recv(READ_MAX)
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class DescriptorTransport:
    """An open, raw terminal or socket by its file descriptor, which `close` closes, such as a pseudo-terminal's end."""

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor: int | None = descriptor

    @property
    def closed(self) -> bool:
        return self._descriptor is None

    def fileno(self) -> int:
        descriptor = self._descriptor  # another thread may be closing it
        return -1 if descriptor is None else descriptor

    def write(self, data: bytes) -> bool:
        while data and self._descriptor is not None:
            _, writable, _ = select.select([], [self._descriptor], [], WRITE_TIMEOUT_S)
            if not writable:
                return False
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:
                return False
            except OSError:
                self.close()
        return not data

    def read(self) -> bytes:
        if self._descriptor is None:
            return b""
        try:
            data = os.read(self._descriptor, READ_MAX)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()  # terminals raise EIO and sockets return nothing once the other end is gone
        return data

    def close(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def check_port(text: str, what: str = "a port") -> None:
    """Check that a text has the form of a port, without opening it; `what` names it in errors.

    Raises:
        TransportError: the text is none of /dev/ttyUSB0, pty:PATH and tcp:HOST:PORT.
    """
    kind, _, rest = text.partition(":")
    if kind == "tcp":
        host, _, port = rest.rpartition(":")
        if not host or not port.isdecimal() or int(port) not in _TCP_PORTS:
            raise TransportError(
                f"{what} tcp:HOST:PORT needs a host and a number from 1 to {_TCP_PORTS[-1]}, not '{text}'"
            )
    elif not (rest if kind == "pty" else text).startswith("/"):
        raise TransportError(f"{what} must be /dev/..., pty:/dev/pts/N or tcp:HOST:PORT, not '{text}'")


def transport_from_text(text: str, what: str = "a port") -> Transport:
    """Open a port given as /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT; `what` names it in errors.

    Raises:
        TransportError: see `check_port`; or the port cannot be opened, or a pseudo-terminal's link is older than the
            terminal.
    """
    check_port(text, what)
    kind, _, rest = text.partition(":")
    if kind == "tcp":
        host, _, port = rest.rpartition(":")
        return TcpTransport(host, int(port))
    path = rest if kind == "pty" else text
    if kind == "pty" and not Path(path).exists():
        raise TransportError(f"there is no terminal {path}: start the program that makes it, such as the simulator")
    if kind == "pty" and _is_older_than_its_terminal(Path(path)):
        raise TransportError(f"{path} leads to another program's terminal: restart the program that made it")
    return SerialTransport(path)


def _is_older_than_its_terminal(link: Path) -> bool:
    """Return whether a link was made before the terminal that it leads to now.

    A killed program leaves its link behind, and its terminal's number goes to the next program (pts(4)). The link would
    then lead to another program's board and take that program's answers.
    """
    try:
        return link.is_symlink() and link.stat().st_ctime_ns > link.lstat().st_mtime_ns
    except OSError:
        return False  # no terminal: opening it raises the error


class Reconnecting:
    """A transport that is opened again after a loss, at most once every `pause_ns`.

    `connections` counts the openings: after a change the user must shake hands again. The caller must call `poll` once a
    tick with the time of a monotonic clock.
    """

    def __init__(
        self, connect: Callable[[], Transport], pause_ns: int = 500_000_000, patience_s: float | None = None
    ) -> None:
        """`connect` opens the transport or raises TransportError; `poll` waits up to `patience_s` for it.

        After that the attempt continues in its own thread. None waits for its end, which a simulated clock needs.
        """
        self.connections = 0
        self.reason = "the cable to the board was not opened yet"
        self._connect = connect
        self._pause_ns = pause_ns
        self._patience_s = patience_s
        self._opening: Future[Transport] | None = None
        self._transport: Transport | None = None
        self._tried_ns: int | None = None

    @property
    def closed(self) -> bool:
        return self._transport is None or self._transport.closed

    def poll(self, now_ns: int) -> bool:
        """Open the transport if it is closed and an attempt is due; return whether it is open, else see `reason`."""
        if not self.closed:
            return True
        if self._opening is None:
            if self._tried_ns is not None and 0 <= now_ns - self._tried_ns < self._pause_ns:
                return False
            self._tried_ns = now_ns
            self._opening = self._start_opening()
        if not self._opening.done():
            self.reason = "the cable to the board is being opened: wait for it"
            return False
        opening, self._opening = self._opening, None
        try:
            self._transport = opening.result()
        except TransportError as error:
            self.reason = str(error)
            return False
        self.connections += 1
        self.reason = "the cable to the board was lost: plug it in again"
        return True

    def _start_opening(self) -> Future[Transport]:
        """Start an attempt and wait for it up to `patience_s`."""
        opening: Future[Transport] = Future()
        if self._patience_s is None:
            _open(self._connect, opening)
            return opening
        thread = threading.Thread(target=_open, args=(self._connect, opening), name="cable", daemon=True)
        thread.start()
        thread.join(self._patience_s)
        return opening

    def write(self, data: bytes) -> bool:
        return self._transport is not None and self._transport.write(data)

    def read(self) -> bytes:
        return b"" if self._transport is None else self._transport.read()

    def wait(self, timeout_s: float) -> None:
        """Wait until bytes arrive, at most `timeout_s`; a negative time does not wait."""
        timeout_s = max(timeout_s, 0.0)
        descriptor = -1 if self._transport is None else self._transport.fileno()
        if descriptor < 0:
            time.sleep(timeout_s)
            return
        with contextlib.suppress(OSError, ValueError):  # closed by another thread meanwhile
            select.select([descriptor], [], [], timeout_s)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


def _open(connect: Callable[[], Transport], opening: Future[Transport]) -> None:
    """Store the result of an attempt, or its error."""
    try:
        opening.set_result(connect())
    except BaseException as error:  # noqa: BLE001 - raised again by `result`
        opening.set_exception(error)


def open_pseudo_terminal() -> tuple[int, int, str]:
    """Return the raw descriptors of both ends and the path of the second: (board, computer, path).

    Raises:
        TransportError: the system has no pseudo-terminal left.
    """
    try:
        board, computer = os.openpty()
    except OSError as error:
        raise TransportError(f"no pseudo-terminal can be opened: {error}; close some") from error
    tty.setraw(computer)
    return board, computer, os.ttyname(computer)
