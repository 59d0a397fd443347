"""Cables: no call waits without limit, none raises when the other end closes, and a lost cable is reopened."""

from __future__ import annotations

import builtins
import os
import socket
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from waychair.errors import TransportError
from waychair.firmware_bridge.transports import (
    DescriptorTransport,
    Reconnecting,
    SerialTransport,
    TcpTransport,
    Transport,
    open_pseudo_terminal,
    transport_from_text,
)

LONG_S = 0.5
"""A limit far above the duration of any call."""


@pytest.fixture
def terminal() -> Iterator[tuple[int, int, str]]:
    board, computer, path = open_pseudo_terminal()
    yield board, computer, path
    for descriptor in (board, computer):
        try:
            os.close(descriptor)
        except OSError:
            continue


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def _eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.001)
    return False


def _read(transport: Transport, count: int) -> bytes:
    """Bytes as they come, for as long as they may take."""
    data, deadline = b"", time.monotonic() + 2.0
    while len(data) < count and not transport.closed and time.monotonic() < deadline:
        data += transport.read()
        time.sleep(0.001)
    return data


def test_a_serial_port_carries_every_byte_both_ways(terminal: tuple[int, int, str]) -> None:
    board, _, path = terminal
    port, every = SerialTransport(path), bytes(range(256))
    assert port.write(every)
    assert os.read(board, 1000) == every
    os.write(board, every)
    assert _read(port, 256) == every
    assert port.read() == b""
    port.close()
    port.close()
    assert port.closed


def test_a_link_to_a_closed_terminal_is_refused_even_if_the_number_is_in_use_again(tmp_path: Path) -> None:
    board, computer, path = open_pseudo_terminal()
    link = tmp_path / "board"
    link.symlink_to(path)
    transport_from_text(f"pty:{link}").close()
    os.close(board)
    os.close(computer)
    with pytest.raises(TransportError):
        transport_from_text(f"pty:{link}")
    strangers = []
    time.sleep(0.05)  # the system's stamps are of its ticks
    while not Path(path).exists():
        strangers.append(open_pseudo_terminal())
    with pytest.raises(TransportError, match="leads to another program's terminal"):
        transport_from_text(f"pty:{link}")
    for near, far, _ in strangers:
        os.close(near)
        os.close(far)


def test_a_full_serial_line_returns_in_time_and_does_not_block(terminal: tuple[int, int, str]) -> None:
    port = SerialTransport(terminal[2])
    began = time.monotonic()
    while port.write(b"\x55" * 4096):
        assert time.monotonic() - began < 5.0
    assert time.monotonic() - began < 5.0
    began = time.monotonic()
    assert not port.write(b"\x55" * 4096)
    assert time.monotonic() - began < LONG_S
    assert not port.closed
    port.close()


def test_a_pulled_serial_cable_is_closed_and_ignores_later_writes(terminal: tuple[int, int, str]) -> None:
    board, computer, path = terminal
    port = SerialTransport(path)
    os.close(board)
    os.close(computer)
    deadline = time.monotonic() + 2.0
    while not port.closed and time.monotonic() < deadline:
        port.read()
        port.write(b"x")
    assert port.closed
    assert not port.write(b"x")
    assert port.read() == b""


def test_a_missing_serial_port_is_refused_with_advice(tmp_path: Path) -> None:
    with pytest.raises(TransportError, match=r"there is no serial port .*: plug the board in"):
        SerialTransport(str(tmp_path / "ttyUSB0"))


@pytest.mark.parametrize("call", ["tcsetattr", "tcflush"])
def test_a_serial_port_that_vanishes_while_it_is_opened_is_refused_and_tried_again(
    terminal: tuple[int, int, str], monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    def gone(*_: object) -> None:
        raise termios.error(5, "Input/output error")

    cable = Reconnecting(lambda: SerialTransport(terminal[2]), pause_ns=500)
    monkeypatch.setattr(termios, call, gone)
    assert not cable.poll(0)
    assert "cannot open the serial port" in cable.reason
    monkeypatch.undo()
    assert cable.poll(500)
    cable.close()


def test_a_serial_port_closed_by_another_thread_has_no_descriptor_and_is_not_waited_for(
    terminal: tuple[int, int, str],
) -> None:
    port = SerialTransport(terminal[2])
    cable = Reconnecting(lambda: port)
    assert cable.poll(0)
    whole, port._port.fd = port._port.fd, None  # as pyserial's close leaves it for a moment
    cable.wait(0.001)
    assert port.fileno() == -1
    assert not port.write(b"x")
    assert port.read() == b""
    os.close(whole)


def test_a_serial_port_belongs_to_one_program(terminal: tuple[int, int, str]) -> None:
    first = SerialTransport(terminal[2])
    with pytest.raises(TransportError, match=terminal[2]):
        SerialTransport(terminal[2])
    first.close()


def test_without_pyserial_a_serial_port_is_refused_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any, **named: Any) -> Any:
        if name == "serial":
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(TransportError, match="pip install pyserial"):
        SerialTransport("/dev/ttyUSB0")


def test_a_tcp_connection_carries_bytes_and_reports_its_end(listener: socket.socket) -> None:
    transport = TcpTransport(*listener.getsockname())
    peer, _ = listener.accept()
    assert transport.read() == b""
    assert transport.write(b"\0ab\xff")
    assert peer.recv(10) == b"\0ab\xff"
    peer.sendall(b"back")
    assert _read(transport, 4) == b"back"
    peer.close()
    _read(transport, 1)
    assert transport.closed
    assert not transport.write(b"x")
    assert transport.read() == b""
    transport.close()


def test_a_write_to_a_tcp_peer_that_does_not_read_returns_at_once(listener: socket.socket) -> None:
    transport = TcpTransport(*listener.getsockname())
    peer, _ = listener.accept()
    while transport.write(b"x" * 100_000):
        pass
    began = time.monotonic()
    assert not transport.write(b"x" * 10_000_000)
    assert time.monotonic() - began < LONG_S
    peer.close()
    deadline = time.monotonic() + 2.0
    while not transport.closed and time.monotonic() < deadline:
        transport.write(b"x" * 1000)
    assert transport.closed


def test_a_tcp_address_without_a_listener_is_refused_with_advice(listener: socket.socket) -> None:
    host, port = listener.getsockname()
    listener.close()
    with pytest.raises(TransportError, match="cannot connect"):
        TcpTransport(host, port)


def test_a_descriptor_carries_bytes_and_reports_its_end() -> None:
    ours, theirs = socket.socketpair()
    transport = DescriptorTransport(ours.detach())
    assert transport.write(b"there")
    assert theirs.recv(10) == b"there"
    assert transport.read() == b""
    theirs.sendall(b"back")
    assert _read(transport, 4) == b"back"
    theirs.close()
    assert transport.read() == b""
    assert transport.closed
    assert transport.fileno() == -1
    assert not transport.write(b"x")
    assert transport.write(b"") is True
    transport.close()


def test_a_write_to_a_full_descriptor_returns_at_once() -> None:
    ours, theirs = socket.socketpair()
    transport = DescriptorTransport(ours.detach())
    while transport.write(b"x" * 10_000):
        pass
    began = time.monotonic()
    assert not transport.write(b"x" * 10_000)
    assert time.monotonic() - began < LONG_S
    theirs.close()
    assert not transport.write(b"x")
    assert transport.closed


def test_a_slow_reader_still_gets_every_byte() -> None:
    ours, theirs = socket.socketpair()
    theirs.settimeout(2.0)
    transport, got = DescriptorTransport(ours.detach()), bytearray()

    def drain() -> None:
        while part := theirs.recv(65536):
            got.extend(part)

    reader = threading.Thread(target=drain)
    reader.start()
    assert transport.write(bytes(range(256)) * 4000)
    transport.close()
    reader.join(5.0)
    theirs.close()
    assert bytes(got) == bytes(range(256)) * 4000


class Cable:
    """A connection that tests pull and plug."""

    def __init__(self) -> None:
        self.plugged = False
        self.tried = 0
        self.ends: list[socket.socket] = []

    def connect(self) -> Transport:
        self.tried += 1
        if not self.plugged:
            raise TransportError("no board")
        ours, theirs = socket.socketpair()
        self.ends.append(theirs)
        return DescriptorTransport(ours.detach())


def test_a_lost_cable_is_reopened_no_more_often_than_configured() -> None:
    cable = Cable()
    line = Reconnecting(cable.connect, pause_ns=500)
    assert line.closed
    assert not line.write(b"x")
    assert line.read() == b""
    assert [line.poll(now) for now in (0, 100, 499, 500, 999)] == [False] * 5
    assert cable.tried == 2
    assert line.reason == "no board"
    cable.plugged = True
    assert not line.poll(999)
    assert line.poll(1000)
    assert line.connections == 1
    assert line.write(b"hello")
    assert cable.ends[0].recv(10) == b"hello"
    cable.ends[0].close()
    assert line.read() == b""
    assert line.closed
    assert "lost" in line.reason
    assert line.poll(2000)
    assert line.connections == 2
    cable.ends[1].sendall(b"again")
    assert _read(line, 5) == b"again"
    line.close()
    assert line.closed
    cable.ends[1].close()


def test_a_cable_that_takes_long_to_open_is_not_waited_for() -> None:
    cable, answers = Cable(), threading.Event()

    def connect() -> Transport:
        answers.wait(20.0)
        return cable.connect()

    line = Reconnecting(connect, pause_ns=500, patience_s=0.01)
    began = time.monotonic()
    assert [line.poll(now) for now in range(0, 500, 10)] == [False] * 50
    assert time.monotonic() - began < LONG_S
    assert "being opened" in line.reason
    answers.set()
    assert _eventually(lambda: line.poll(499) or line.reason == "no board")
    assert (cable.tried, line.poll(499)) == (1, False)
    cable.plugged = True
    assert _eventually(lambda: line.poll(500))
    assert (cable.tried, line.connections) == (2, 1)
    line.close()
    cable.ends[0].close()


def test_a_lack_of_pseudo_terminals_is_an_error_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left() -> tuple[int, int]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "openpty", none_left)
    with pytest.raises(TransportError, match="close some"):
        open_pseudo_terminal()
