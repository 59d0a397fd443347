"""The same bridge over every cable, in real time, and processes that stop: the tests assert results, not times."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from waychair.calibration.fits.dac import DEFAULT
from waychair.firmware_bridge.board import HostBoard, at_rest
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.fail_safe import BUDGET_MS
from waychair.firmware_bridge.heartbeat import Heartbeat
from waychair.firmware_bridge.protocol import BoardFault, BoardState, Family, Holder
from waychair.firmware_bridge.round_trip import board_in_real_time, round_trips_ms
from waychair.firmware_bridge.steady_computer import PERIOD_MS, TICK, WRITTEN
from waychair.firmware_bridge.transports import DescriptorTransport, Reconnecting, SerialTransport, TcpTransport

PATIENCE_S = 20.0


def _eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.01)
    return False


def _is_greeted(bridge: Bridge) -> bool:
    report = bridge.telemetry
    return report is not None and report.round_trip_ns is not None and bridge.trouble == ()


@pytest.mark.parametrize("opened", [SerialTransport, lambda path: DescriptorTransport(os.open(path, os.O_RDWR))])
def test_the_bridge_works_with_a_board_on_a_terminal(
    board_program: Path, opened: Callable[[str], SerialTransport | DescriptorTransport]
) -> None:
    with board_in_real_time(board_program) as (path, _):
        cable = Reconnecting(lambda: opened(path))
        bridge = Bridge(cable, DEFAULT, "A")
        with Heartbeat(bridge, cable):
            assert _eventually(lambda: _is_greeted(bridge))
        cable.close()


def test_the_bridge_works_with_a_board_behind_tcp(board_program: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        host, port = server.getsockname()
        cable = Reconnecting(lambda: TcpTransport(host, port))
        bridge = Bridge(cable, DEFAULT, "A")
        assert "silent" in bridge.beat(time.monotonic_ns()).reason or cable.connections == 1
        ours, _ = server.accept()
        ours.setblocking(False)
        words = ["--serial-fd", str(ours.fileno()), "--realtime", "--chair", "A", "--family", "3"]
        board = subprocess.Popen([board_program, *words], pass_fds=(ours.fileno(),))
        try:
            with Heartbeat(bridge, cable):
                assert _eventually(lambda: _is_greeted(bridge))
                board.kill()
                board.wait()
                ours.close()
                assert _eventually(lambda: bridge.trouble != ())
        finally:
            board.kill()
            board.wait()
            cable.close()


def test_in_real_time_every_command_is_echoed(board_program: Path) -> None:
    times, _ = round_trips_ms(board_program, 20, urgently=False)
    assert times.shape == (20,)
    assert (times > 0.0).all()


def test_f17_a_computer_stopped_by_sigstop_loses_the_lines_in_100_ms_of_the_boards_time(board_program: Path) -> None:
    with HostBoard(board_program) as board:
        words = [sys.executable, "-m", "waychair.firmware_bridge.steady_computer", board.path, "8000", "-4000"]
        computer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        assert computer.stdin is not None
        assert computer.stdout is not None
        try:
            for now_ms in range(PERIOD_MS, 2500, PERIOD_MS):
                os.write(computer.stdin.fileno(), TICK.pack(now_ms, 0))
                board.transport.written = WRITTEN.unpack(os.read(computer.stdout.fileno(), WRITTEN.size))[0]
                lines = board.step(now_ms, at_rest())
            assert (lines.state, lines.holder) == (BoardState.DRIVE, Holder.BOARD)
            os.kill(computer.pid, signal.SIGSTOP)
            os.write(computer.stdin.fileno(), TICK.pack(now_ms + PERIOD_MS, 0))  # it will not get this
            for after in range(1, BUDGET_MS + 1):
                lines = board.step(now_ms + after, at_rest())
            assert (lines.holder, lines.forward_mv, lines.turn_mv) == (Holder.JOYSTICK, 2500, 2500)
            assert lines.faults == BoardFault.HOST_SILENT
            os.kill(computer.pid, signal.SIGCONT)
            board.transport.written = WRITTEN.unpack(os.read(computer.stdout.fileno(), WRITTEN.size))[0]
            for after in range(BUDGET_MS + 1, 300):
                lines = board.step(now_ms + after, at_rest())
            assert lines.holder is Holder.JOYSTICK  # resumed, it drives on and is ignored
        finally:
            computer.kill()
            computer.wait()
            computer.stdin.close()
            computer.stdout.close()


def test_families_have_the_reference_that_the_board_names() -> None:
    assert {family: at_rest(family).reference_mv for family in Family if family} == {1: 2500, 2: 5800, 3: 1650}
