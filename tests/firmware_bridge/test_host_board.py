"""The shipped firmware as a program in lockstep: the chair's lines when parts around it break or die."""

from __future__ import annotations

import os
import select
import signal
import stat
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from waychair.errors import BoardBuildError, BridgeError
from waychair.firmware_bridge.board import (
    BoardInputs,
    BoardSettings,
    Defect,
    HostBoard,
    LineState,
    at_rest,
    build_board,
)
from waychair.firmware_bridge.fail_safe import BUDGET_MS, KillReport, KillTrial, kill_board, kill_host
from waychair.firmware_bridge.protocol import (
    BoardFault,
    BoardState,
    BoardTelemetry,
    Command,
    Decoder,
    Family,
    HandshakeRefusal,
    HelloReply,
    Holder,
    Limit,
    Message,
    encode,
    hello,
    line_millivolts,
)
from waychair.firmware_bridge.transports import DescriptorTransport, open_pseudo_terminal

FORWARD, TURN = 8000, -4000
REACHED = (2500 + 960, 2500 - 480)
"""Lines [mV] at that command."""


class Computer:
    """A board and the computer that commands it every 20 ms."""

    def __init__(self, board: HostBoard) -> None:
        self.board = board
        self.now_ms = 0
        self.sequence = 0
        self.inputs = at_rest()
        self.heard: list[Message] = []
        self._decoder = Decoder()

    def send(self, message: Message) -> None:
        """A frame to the board."""
        self.board.transport.write(encode(message, self.sequence))
        self.sequence += 1

    def run(self, ms: int, forward: int = 0, turn: int = 0, flags: int = 1, talks: bool = True) -> LineState:
        """So many steps of a millisecond."""
        for _ in range(ms):
            if talks and self.now_ms % 20 == 0:
                self.send(Command(forward, turn, flags, self.now_ms * 1000))
            self.now_ms += 1
            state = self.board.step(self.now_ms, self.inputs)
            self.heard += [received.message for received in self._decoder.feed(self.board.transport.read())]
        return state

    def drive(self) -> LineState:
        """Handshake, hold, and up to the command."""
        self.send(hello(self.board.settings.chair_id, Family.HALL_5V))
        self.run(2100)
        state = self.run(300, FORWARD, TURN)
        assert (state.state, state.holder) == (BoardState.DRIVE, Holder.BOARD)
        return state


@pytest.fixture
def computer(board_program: Path) -> Iterator[Computer]:
    with HostBoard(board_program) as board:
        yield Computer(board)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_lines_read_the_command_within_half_a_step_of_the_converter(board_program: Path, bits: int) -> None:
    with HostBoard(board_program, BoardSettings(dac_bits=bits)) as board:
        computer = Computer(board)
        state = computer.drive()
        step = 2800 / (2**bits - 1)
        assert abs(state.forward_mv - REACHED[0]) <= step / 2 + 0.5
        assert abs(state.turn_mv - REACHED[1]) <= step / 2 + 0.5
        reply = computer.heard[0]
        assert isinstance(reply, HelloReply)
        assert (reply.dac_bits, reply.dac_counts_max) == (bits, 2**bits - 1)


@pytest.mark.parametrize("bits", [8, 12])
def test_the_computer_predicts_the_voltages_of_the_lines(board_program: Path, bits: int) -> None:
    with HostBoard(board_program, BoardSettings(dac_bits=bits)) as board:
        computer = Computer(board)
        computer.drive()
        reply = computer.heard[0]
        assert isinstance(reply, HelloReply)
        for setpoint in (-10000, -9999, -5001, -417, -5, -4, 1, 4, 5, 417, 3333, 9999, 10000):
            state = computer.run(400, setpoint, -setpoint)
            assert abs(state.forward_mv - line_millivolts(reply, setpoint)) <= 0.5
            assert abs(state.turn_mv - line_millivolts(reply, -setpoint)) <= 0.5


def test_telemetry_answers_every_command_with_its_stamp_and_the_line_voltages(computer: Computer) -> None:
    computer.drive()
    last = computer.heard[-1]
    assert isinstance(last, BoardTelemetry)
    assert (last.forward_mv, last.turn_mv) == REACHED == (last.forward_set_mv, last.turn_set_mv)
    assert last.echo_stamp_us == 2_380_000
    assert last.echo_sequence == computer.sequence - 1
    assert (last.joystick_forward_mv, last.reference_mv, last.bad_frames, last.rejected) == (2500, 2500, 0, 0)
    answers = [m for m in computer.heard if isinstance(m, BoardTelemetry)]
    assert len({m.echo_stamp_us for m in answers}) == 120


def test_the_same_calls_give_the_same_bytes(board_program: Path) -> None:
    lives = []
    for _ in range(2):
        with HostBoard(board_program) as board:
            computer = Computer(board)
            computer.drive()
            computer.inputs = replace(at_rest(), joystick_turn_mv=3000)
            computer.run(50, FORWARD, TURN)
            lives.append(computer.heard)
    assert lives[0] == lives[1]


@pytest.mark.parametrize(
    ("defect", "axis", "value", "fault", "holder", "within_ms"),
    [
        (Defect.OFFSET, 0, 100, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.OFFSET, 1, -70, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.OPEN, 0, 0, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.OPEN, 1, 0, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.SWAP, 0, 0, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.BRIDGE, 0, 0, BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.LOW, 0, 0, BoardFault.IMPOSSIBLE | BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.HIGH, 1, 0, BoardFault.IMPOSSIBLE | BoardFault.MISMATCH, Holder.CUT, 62),
        (Defect.STICK_OPEN, 1, 0, BoardFault.STICK, Holder.CUT, 262),
        (Defect.CONVERTER_SILENT, 0, 0, BoardFault.BOARD, Holder.JOYSTICK, 22),
    ],
)
def test_f8_f10_f29_a_defect_is_found_and_the_lines_go_to_their_safe_holder(
    computer: Computer, defect: Defect, axis: int, value: int, fault: BoardFault, holder: Holder, within_ms: int
) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=defect, defect_axis=axis, defect_value=value)
    state = computer.run(within_ms, FORWARD, TURN)
    assert (state.state, state.faults, state.holder) == (BoardState.FAULT, fault, holder)
    if holder is Holder.CUT:
        assert (state.forward_mv, state.turn_mv) == (2500, 2500)


@pytest.mark.parametrize("axis", [0, 1])
def test_f8_a_stuck_converter_is_found_as_soon_as_the_command_leaves_it(computer: Computer, axis: int) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=Defect.STUCK, defect_axis=axis)
    assert computer.run(500, FORWARD, TURN).faults == 0
    state = computer.run(75 + 20, -FORWARD, -TURN)
    assert (state.faults, state.holder) == (BoardFault.MISMATCH, Holder.CUT)


def test_f8_a_stuck_switch_is_found_when_the_joystick_should_be_live(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=Defect.WELDED, joystick_forward_mv=3600)
    state = computer.run(100, FORWARD, TURN)
    assert BoardFault.MISMATCH in state.faults
    telemetry = computer.heard[-1]
    assert isinstance(telemetry, BoardTelemetry)
    assert telemetry.holder == Holder.CUT  # asked for; the switch itself cannot follow
    assert state.holder is Holder.BOARD


def test_f9_a_drifting_reference_ends_the_drive(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), reference_mv=2650)
    state = computer.run(262, FORWARD, TURN)
    assert (state.faults, state.holder) == (BoardFault.REFERENCE, Holder.CUT)


def test_f18_the_e_stop_cuts_the_lines_even_while_the_firmware_hangs(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), estop_released=False, defect=Defect.FROZEN)
    state = computer.run(1, FORWARD, TURN)
    assert (state.holder, state.forward_mv, state.turn_mv) == (Holder.CUT, 2500, 2500)


def test_f19_the_riders_stick_is_on_the_lines_within_one_tick(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), joystick_forward_mv=2000)
    state = computer.run(12, FORWARD, TURN)
    assert (state.holder, state.forward_mv, state.turn_mv, state.faults) == (Holder.JOYSTICK, 2000, 2500, 0)


@pytest.mark.parametrize(
    ("wrong", "refusal"),
    [
        ({"version": 3}, HandshakeRefusal.VERSION),
        ({"version": 1, "layout_hash": 0x0C2E4D12}, HandshakeRefusal.VERSION | HandshakeRefusal.LAYOUT),
        ({"layout_hash": 1}, HandshakeRefusal.LAYOUT),
        ({"chair_id": b"B".ljust(16, b"\0")}, HandshakeRefusal.CHAIR),
        ({"chair_id": b"A".ljust(15, b"\0") + b"x"}, HandshakeRefusal.CHAIR),
        ({"family": 2}, HandshakeRefusal.FAMILY),
        ({"version": 9, "family": 0}, HandshakeRefusal.VERSION | HandshakeRefusal.FAMILY),
    ],
)
def test_f22_a_wrong_handshake_is_refused_by_name_and_never_armed(
    computer: Computer, wrong: dict[str, int | bytes], refusal: HandshakeRefusal
) -> None:
    computer.send(replace(hello("A", Family.HALL_5V), **wrong))  # type: ignore[arg-type]
    assert computer.run(2500).state is BoardState.SILENT
    assert computer.run(100, FORWARD).holder is Holder.JOYSTICK
    reply, telemetry = computer.heard[0], computer.heard[-1]
    assert isinstance(reply, HelloReply)
    assert isinstance(telemetry, BoardTelemetry)
    assert reply.refused == refusal
    assert telemetry.rejected == 130


def test_a_guard_copies_the_stick_within_the_caps_and_a_dead_computer_leaves_it_narrow(computer: Computer) -> None:
    computer.send(hello("A", Family.HALL_5V))

    def limited(ms: int, caps: tuple[int, int, int, int]) -> LineState:
        for _ in range(ms):
            if computer.now_ms % 20 == 0:
                computer.send(Limit(*caps, 9, 77))
            state = computer.run(1, talks=False)
        return state

    assert limited(2520, (5000, 5000, 0, 10000)).state is BoardState.GUARD
    computer.inputs = replace(computer.inputs, joystick_forward_mv=3600, joystick_turn_mv=2000)
    state = limited(20, (5000, 5000, 0, 10000))
    assert abs(state.forward_mv - 3100) <= 1
    assert (state.turn_mv, state.holder, state.faults) == (2500, Holder.BOARD, 0)
    told = computer.heard[-1]
    assert isinstance(told, BoardTelemetry)
    assert (told.front_cap, told.rear_cap, told.left_cap, told.right_cap) == (5000, 5000, 0, 10000)
    assert (told.guard_bits, told.echo_stamp_us, told.state) == (1, 77, BoardState.GUARD)
    state = computer.run(100, talks=False)
    assert abs(state.forward_mv - 2800) <= 1
    assert (state.turn_mv, state.faults) == (2500, BoardFault.HOST_SILENT)
    told = computer.heard[-1]
    assert isinstance(told, BoardTelemetry)
    assert told.guard_bits == 9
    computer.inputs = at_rest()
    state = computer.run(2001, talks=False)
    assert (state.state, state.holder, state.faults) == (BoardState.SILENT, Holder.JOYSTICK, 0)


def test_f22_a_board_without_a_joystick_family_refuses_to_arm_and_its_joystick_is_live(board_program: Path) -> None:
    with HostBoard(board_program, BoardSettings(family=Family.NONE)) as board:
        computer = Computer(board)
        computer.send(hello("A", Family.NONE))
        computer.inputs = BoardInputs(3000, 2100, 2500)
        state = computer.run(2500)
        assert (state.holder, state.forward_mv, state.turn_mv) == (Holder.JOYSTICK, 3000, 2100)
        reply = computer.heard[0]
        assert isinstance(reply, HelloReply)
        assert reply.refused == HandshakeRefusal.CONFIG


def test_f3_noise_on_the_line_is_counted_and_ends_the_drive(computer: Computer) -> None:
    computer.drive()
    for _ in range(5):
        computer.board.transport.write(b"\x03noise\x00")
    state = computer.run(30, FORWARD, TURN)
    assert (state.faults, state.holder) == (BoardFault.BAD_FRAMES, Holder.JOYSTICK)
    telemetry = computer.heard[-1]
    assert isinstance(telemetry, BoardTelemetry)
    assert telemetry.bad_frames == 5


def test_a_burst_of_frames_is_processed_one_a_step(computer: Computer) -> None:
    computer.drive()
    for forward in (FORWARD, 20000, 0):  # the middle one is a fault that the last one must not hide
        computer.send(Command(forward, 0, 1, 0))
    assert computer.run(5, talks=False).faults == BoardFault.RANGE


def test_f29_frozen_firmware_loses_the_lines_and_reboots(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=Defect.FROZEN)
    assert computer.run(30, FORWARD, TURN).holder is Holder.BOARD
    assert computer.run(40, FORWARD, TURN).holder is Holder.JOYSTICK
    computer.inputs = at_rest()
    state = computer.run(100, FORWARD, TURN)
    assert (state.state, state.holder) == (BoardState.SILENT, Holder.JOYSTICK)


def test_f29_a_pause_shorter_than_the_watchdog_has_no_effect(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=Defect.FROZEN)
    computer.run(25, FORWARD, TURN)
    computer.inputs = at_rest()
    state = computer.run(60, FORWARD, TURN)
    assert (state.state, state.holder, state.faults) == (BoardState.DRIVE, Holder.BOARD, 0)


def test_f29_a_brown_out_gives_the_lines_to_the_joystick_at_once(computer: Computer) -> None:
    computer.drive()
    computer.inputs = replace(at_rest(), defect=Defect.BROWN_OUT, joystick_turn_mv=2700)
    state = computer.run(1, FORWARD, TURN)
    assert (state.holder, state.turn_mv, state.state) == (Holder.JOYSTICK, 2700, BoardState.SILENT)
    computer.inputs = at_rest()
    assert computer.run(500, FORWARD, TURN).state is BoardState.SILENT


def test_f16_a_clock_that_goes_back_leaves_the_joystick_live(computer: Computer) -> None:
    computer.drive()
    computer.now_ms -= 1000
    assert computer.run(1, FORWARD, TURN).holder is Holder.JOYSTICK


def test_f1_the_computer_is_killed_at_random_moments_and_the_joystick_is_live_in_100_ms(board_program: Path) -> None:
    report = kill_host(board_program, 20, seed=7)
    assert len(report.trials) == 20
    assert report.failures == ()
    assert 60 <= report.longest_ms <= BUDGET_MS
    assert report.failure_bound == pytest.approx(1 - 0.05 ** (1 / 20))


def test_f29_the_board_dies_at_random_moments_and_the_joystick_is_live_in_100_ms(board_program: Path) -> None:
    report = kill_board(board_program, 21, seed=7)
    assert {trial.killed for trial in report.trials} == {"frozen", "brown-out", "killed"}
    assert report.failures == ()
    assert 1 <= report.longest_ms <= BUDGET_MS


def test_a_death_without_a_live_joystick_in_time_counts_as_a_failure() -> None:
    trials = (
        KillTrial("host", 2200, (1, 1), 100),
        KillTrial("host", 2200, (1, 1), 101),
        KillTrial("host", 2200, (1, 1), None),
    )
    report = KillReport(trials)
    assert report.failures == trials[1:]
    assert report.longest_ms == 101
    assert 0.66 < report.failure_bound < 1.0
    assert KillReport(trials[1:]).failure_bound == 1.0


def test_a_dead_board_leaves_the_lines_to_the_joystick_or_the_e_stop(computer: Computer) -> None:
    computer.drive()
    computer.board.kill()
    assert not computer.board.alive
    computer.inputs = replace(at_rest(), joystick_forward_mv=2600)
    assert computer.run(1, FORWARD, TURN).forward_mv == 2600
    computer.inputs = replace(computer.inputs, estop_released=False)
    assert computer.run(1, FORWARD, TURN).holder is Holder.CUT


def test_a_board_that_does_not_answer_is_an_error_with_advice(
    computer: Computer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.firmware_bridge.board.TIMEOUT_S", 0.05)
    computer.run(1)
    os.kill(computer.board._process.pid, signal.SIGSTOP)
    with pytest.raises(BridgeError, match="did not answer"):
        computer.run(1)


@pytest.mark.parametrize("wrong", [{"joystick_forward_mv": -1}, {"reference_mv": 70000}, {"joystick_turn_mv": 2.5}])
def test_impossible_voltages_are_refused_with_advice(computer: Computer, wrong: dict[str, float]) -> None:
    with pytest.raises(BridgeError, match="whole millivolts"):
        computer.board.step(1, replace(at_rest(), **wrong))  # type: ignore[arg-type]


def test_the_board_is_built_once_for_the_same_sources(tmp_path: Path) -> None:
    program = build_board(tmp_path)
    built = program.stat().st_mtime_ns
    assert build_board(tmp_path) == program
    assert program.stat().st_mtime_ns == built
    assert program.stat().st_mode & stat.S_IXUSR


def test_a_missing_compiler_is_an_error_with_advice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BoardBuildError, match="install gcc or clang"):
        build_board(tmp_path / "board")
    monkeypatch.setenv("CC", str(tmp_path / "nothing"))
    with pytest.raises(BoardBuildError, match="cannot be run"):
        build_board(tmp_path / "board")


def test_a_program_that_cannot_start_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BoardBuildError, match="build the board again"):
        HostBoard(tmp_path / "nothing")


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--realtime"],
        ["--serial", "/nowhere", "--realtime"],
        ["--serial-fd", "0"],
        ["--serial-fd", "0", "--realtime", "--lockstep", "0,1"],
        ["--serial-fd", "0", "--lockstep", "0"],
        ["--serial-fd", "0", "--realtime", "--dac-bits", "7"],
        ["--serial-fd", "0", "--realtime", "--dac-bits", "17"],
        ["--serial-fd", "x", "--realtime"],
        ["--serial-fd", "0", "--realtime", "--chair", "a name that is too long"],
        ["--serial-fd", "0", "--realtime", "--wings", "2"],
        ["--serial-fd", "0", "--realtime", "--family"],
    ],
)
def test_the_program_refuses_invalid_options(board_program: Path, words: list[str]) -> None:
    done = subprocess.run([board_program, *words], capture_output=True, text=True, timeout=5, check=False)
    assert done.returncode == 2
    assert "main.c" in done.stderr


def test_in_real_time_the_board_answers_on_a_terminal_given_by_path(board_program: Path) -> None:
    ours, theirs, path = open_pseudo_terminal()
    program = subprocess.Popen([board_program, "--serial", path, "--realtime", "--chair", "A"])
    transport, decoder = DescriptorTransport(ours), Decoder()
    try:
        replies: list[Message] = []
        deadline = time.monotonic() + 5.0
        transport.write(encode(hello("A", Family.HALL_5V), 0))
        while time.monotonic() < deadline and not any(isinstance(m, HelloReply) for m in replies):
            select.select([transport], [], [], 0.1)
            replies += [received.message for received in decoder.feed(transport.read())]
        transport.write(encode(Command(0, 0, 1, 4711), 1))
        while time.monotonic() < deadline and not any(getattr(m, "echo_stamp_us", 0) == 4711 for m in replies):
            select.select([transport], [], [], 0.1)
            replies += [received.message for received in decoder.feed(transport.read())]
        assert any(isinstance(m, HelloReply) and m.refused == 0 for m in replies)
        assert any(isinstance(m, BoardTelemetry) and m.echo_stamp_us == 4711 for m in replies)
    finally:
        program.kill()
        program.wait()
        transport.close()
        os.close(theirs)
