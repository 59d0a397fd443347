"""Faults reported by the board, with the shipped firmware: messages, the end of a drive, and resets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.firmware_bridge.bridged import BOARD, GOOD, MS, TICK_MS, Bridged
from waychair.errors import BridgeError
from waychair.firmware_bridge import bridge as bridge_module
from waychair.firmware_bridge.advice import handshake_problem
from waychair.firmware_bridge.board import BoardSettings, Defect
from waychair.firmware_bridge.bridge import BridgeSettings
from waychair.firmware_bridge.protocol import (
    FIRMWARE_VERSION,
    LAYOUT_HASH,
    BoardFault,
    BoardState,
    BoardTelemetry,
    Decoder,
    Family,
    HelloReply,
    Holder,
    encode,
    hello,
)


def test_a_goal_right_after_a_reset_does_not_undo_the_reset(link: Bridged) -> None:
    link.drive()
    link.inputs = replace(link.inputs, estop_released=False)
    link.run(100, None)
    link.inputs = replace(link.inputs, estop_released=True)
    link.bridge.reset(by_rider=True)
    link.bridge.reset()
    link.drive()
    assert link.bridge.armed


@pytest.mark.parametrize(
    ("board", "settings", "chair_id", "reason"),
    [
        (BOARD, None, "B", "built into chair 'A'"),
        (replace(BOARD, chair_id="another"), None, "A", "built into chair 'another'"),
        (replace(BOARD, family=Family.HALL_5V), None, "A", "joystick family 1"),
        (replace(BOARD, family=Family.HALL_5V), BridgeSettings(family=Family.HALL_5V), "A", "expects motion"),
        (replace(BOARD, family=Family.INDUCTIVE_12V), BridgeSettings(family=Family.INDUCTIVE_12V), "A", "5.8 V"),
        (replace(BOARD, override_per_mille=90), None, "A", "configure and flash"),
    ],
)
def test_f22_a_wrong_board_or_calibration_is_named_and_never_armed(
    board_program: Path, board: BoardSettings, settings: BridgeSettings | None, chair_id: str, reason: str
) -> None:
    with Bridged(board_program, board, settings, chair_id=chair_id) as link:
        sent = link.run(3000, GOOD)
        assert not sent.active
        assert reason in sent.reason
        assert reason in link.bridge.trouble[0]
        assert link.lines.state is BoardState.SILENT
        assert link.joystick_is_live


def test_f22_the_protocol_without_a_guard_and_the_one_with_it_refuse_each_other() -> None:
    new = hello("A", Family.HALL_5V)
    old = replace(new, version=1, layout_hash=0x0C2E4D12)
    reply = HelloReply(1, old.layout_hash, 0x0100, new.chair_id, Family.HALL_5V, 0, 12, 4095, 2500, 1200, 1100, 3900)
    assert "protocol 1 and this computer 2" in handshake_problem(reply, new)
    assert handshake_problem(replace(reply, firmware_version=FIRMWARE_VERSION), old) == ""
    current = replace(reply, version=2, layout_hash=LAYOUT_HASH, firmware_version=FIRMWARE_VERSION)
    assert handshake_problem(current, new) == ""
    assert "protocol 2 and this computer 1" in handshake_problem(current, old)
    assert "flash the firmware" in handshake_problem(replace(current, layout_hash=old.layout_hash), new)


def test_f22_an_impossible_board_name_is_an_error_with_advice(board_program: Path) -> None:
    with pytest.raises(BridgeError, match="up to 16"):
        Bridged(board_program, chair_id="a name that is far too long")


def test_f22_a_second_computer_ends_the_drive(link: Bridged) -> None:
    link.drive()
    link.bridge._session._cable.write(bridge_module.BoardSession(link.cable, "A", 3)._greeting())
    link.live(30)
    assert link.joystick_is_live
    assert "another computer" in link.run(500, GOOD).reason


def test_a_line_fault_stays_until_a_person_resets_it(link: Bridged) -> None:
    link.drive()
    link.inputs = replace(link.inputs, defect=Defect.OFFSET, defect_value=200)
    link.run(200, GOOD)
    assert link.lines.holder is Holder.CUT
    assert "wiring" in link.bridge.trouble[0]
    link.inputs = replace(link.inputs, defect=Defect.NONE, defect_value=0)
    link.run(TICK_MS, None)
    link.bridge.reset()
    link.run(1200, None)
    assert link.lines.holder is Holder.CUT
    link.bridge.reset(by_rider=True)
    link.run(200, None)
    assert (link.lines.faults, link.bridge.trouble, link.joystick_is_live) == (0, (), True)
    link.drive()


def test_f18_a_released_e_stop_needs_an_acknowledgement_before_the_next_drive(link: Bridged) -> None:
    link.drive()
    link.inputs = replace(link.inputs, estop_released=False)
    link.run(100, GOOD)
    assert link.lines.holder is Holder.CUT
    assert "emergency stop" in link.bridge.trouble[0]
    link.inputs = replace(link.inputs, estop_released=True)
    link.bridge.reset()
    assert not link.run(3000, GOOD).active
    link.run(TICK_MS, None)
    link.bridge.reset(by_rider=True)
    link.drive()


@pytest.mark.parametrize(("wait_ms", "reset"), [(200, True), (5000, False)])
def test_f18_a_reset_without_a_cable_expires_after_a_second_and_acknowledges_no_later_e_stop(
    link: Bridged, wait_ms: int, reset: bool
) -> None:
    link.run(500, None)
    link.plugged, link.cable._transport = False, None
    link.run(500, None)
    link.bridge.reset(by_rider=True)
    link.run(wait_ms, None)
    link.inputs = replace(link.inputs, estop_released=False)
    link.run(50, None)
    link.inputs = replace(link.inputs, estop_released=True)
    link.plugged = True
    link.run(1000, None)
    assert link.bridge.telemetry is not None
    assert (link.lines.faults == 0) == reset
    assert (link.bridge.trouble == ()) == reset


def test_a_reset_expires_when_the_clock_goes_back(link: Bridged) -> None:
    link.run(500, None)
    link.inputs = replace(link.inputs, estop_released=False)
    link.run(100, None)
    link.bridge.reset(by_rider=True)
    link.run(TICK_MS, None)
    link.bridge.send(None, 0, link.now_ns - 400 * MS)
    link.inputs = replace(link.inputs, estop_released=True)
    link.run(2500, None)
    assert link.lines.faults == BoardFault.ESTOP


def test_f29_a_board_that_reboots_during_a_drive_is_greeted_again_and_nothing_resumes(link: Bridged) -> None:
    link.drive()
    link.inputs = replace(link.inputs, defect=Defect.BROWN_OUT)
    link.run(100, GOOD)
    link.inputs = replace(link.inputs, defect=Defect.NONE)
    assert not link.run(3000, GOOD).active
    assert link.bridge.trouble == ()
    link.run(TICK_MS, None)
    link.drive()


def test_f29_a_hung_board_is_silent_and_its_joystick_is_live(link: Bridged) -> None:
    link.drive()
    link.inputs = replace(link.inputs, defect=Defect.FROZEN)
    link.run(100, GOOD)
    assert link.joystick_is_live
    assert "silent" in link.run(100, GOOD).reason


def test_every_fault_of_the_board_has_a_sentence_with_a_remedy() -> None:
    from waychair.firmware_bridge.advice import FAULT_ADVICE, fault_advice

    assert set(FAULT_ADVICE) == set(BoardFault)
    assert all(": " in advice for advice in FAULT_ADVICE.values())
    both = fault_advice(BoardFault.HOST_SILENT | BoardFault.ESTOP)
    assert len(both) == 2
    assert "emergency stop" in both[0]


def test_unknown_fault_bits_are_as_grave_as_a_line_fault() -> None:
    from waychair.firmware_bridge.advice import UNKNOWN_FAULT, fault_advice, fault_names, is_of_host

    assert fault_advice(1 << 12 | 1 << 15) == (UNKNOWN_FAULT,)
    assert fault_advice(1 << 12 | BoardFault.ESTOP | BoardFault.CLOCK)[1] == UNKNOWN_FAULT
    assert fault_names(1 << 12 | BoardFault.CLOCK) == ("CLOCK", "BIT_12")
    assert is_of_host(BoardFault.CLOCK)
    assert not is_of_host(1 << 12 | BoardFault.CLOCK)


def test_an_unknown_fault_of_a_later_firmware_ends_the_drive_until_a_person_resets_it(
    link: Bridged, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, decoder, unknown = link.board.transport.read, Decoder(), [1 << 12]

    def later() -> bytes:
        """Return the telemetry of a board with another fault bit."""
        said = b""
        for received in decoder.feed(read()):
            message = received.message
            if isinstance(message, BoardTelemetry):
                message = replace(message, state=BoardState.FAULT, faults=message.faults | unknown[0])
            said += encode(message, received.sequence)
        return said

    link.drive()
    monkeypatch.setattr(link.board.transport, "read", later)
    sent = link.run(TICK_MS * 2, GOOD)
    assert (sent.active, "does not know" in sent.reason) == (False, True)
    assert link.bridge.trouble == (sent.reason,)
    assert link.bridge.telemetry is not None
    assert link.bridge.telemetry.faults == ("BIT_12",)
    link.run(TICK_MS, None)
    link.bridge.reset()
    assert link.bridge.trouble == (sent.reason,)
    link.bridge.reset(by_rider=True)
    assert link.bridge.trouble == ()
