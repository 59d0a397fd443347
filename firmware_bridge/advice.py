"""Turns the board's faults and refusals into sentences for the rider: the cause and the remedy."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from waychair.firmware_bridge.protocol import FIRMWARE_VERSION, BoardFault, Family, HandshakeRefusal, Hello, HelloReply

HOST_FAULTS = BoardFault.HOST_SILENT | BoardFault.BAD_FRAMES | BoardFault.RANGE | BoardFault.NEW_HOST | BoardFault.CLOCK
"""Faults of the computer or its cable; lines and board are in order, so a new goal may clear them."""

FAULT_ADVICE: Mapping[BoardFault, str] = MappingProxyType(
    {
        BoardFault.ESTOP: "the emergency stop is pressed, or its wire is broken: release it, then press Reset",
        BoardFault.IMPOSSIBLE: "a joystick line is broken or shorted: have the wiring to the chair checked, then press Reset",
        BoardFault.MISMATCH: "a joystick line does not have the board's voltage: have board and wiring checked, "
        "then press Reset",
        BoardFault.CREEP: "a joystick line is off its neutral at rest: have the board's converter checked, "
        "then press Reset",
        BoardFault.REFERENCE: "the joystick's reference voltage has drifted: have the chair's supply checked, "
        "then press Reset",
        BoardFault.STICK: "a wire of the joystick is broken, so that it could not take over: have it checked, then press Reset",
        BoardFault.BOARD: "the board's converter does not answer or has lost its neutral: switch the board off and on",
        BoardFault.CLOCK: "the board's clock has jumped: let go of the joystick and ask for the goal again",
        BoardFault.NEW_HOST: "another computer connected to the board during the drive: ask for the goal again",
        BoardFault.RANGE: "the board was sent a command beyond the joystick's swing: ask for the goal again",
        BoardFault.BAD_FRAMES: "the cable to the board is noisy: check its plug, then ask for the goal again",
        BoardFault.HOST_SILENT: "the board heard nothing from the computer for too long: ask for the goal again",
    }
)
"""Advice by fault bit, most severe first."""

UNKNOWN_FAULT = (
    "the board reports a fault that this version does not know: have board and wiring checked, install the waychair "
    "that belongs to its firmware, then press Reset"
)
"""Advice for fault bits of a later firmware; as severe as the faults that need a deliberate reset."""


def fault_advice(faults: int) -> tuple[str, ...]:
    """Return a sentence for each fault bit that is set and one for all unknown bits, most severe first."""
    told = {fault: advice for fault, advice in FAULT_ADVICE.items() if fault & faults}
    latching = [advice for fault, advice in told.items() if fault not in HOST_FAULTS]
    unknown = [UNKNOWN_FAULT] if _unknown(faults) else []
    of_host = [advice for fault, advice in told.items() if fault in HOST_FAULTS]
    return (*latching, *unknown, *of_host)


def fault_names(faults: int) -> tuple[str, ...]:
    """Return the name of each fault bit that is set; for an unknown bit its number."""
    unknown = _unknown(faults)
    bits = (f"BIT_{bit}" for bit in range(unknown.bit_length()) if unknown >> bit & 1)
    return (*(str(fault.name) for fault in BoardFault if fault & faults), *bits)


def is_of_host(faults: int) -> bool:
    """Return whether all bits that are set are faults of the computer."""
    return not (int(faults) & ~int(HOST_FAULTS))  # as integers: the complement of a flag has no unknown bits


def _unknown(faults: int) -> int:
    return int(faults) & ~sum(BoardFault)


def handshake_problem(reply: HelloReply, ours: Hello) -> str:
    """Return why the board of this handshake reply must not be used; empty if it may be (F22).

    Refusals by the board and mismatches found by this computer count alike.
    """
    refused = HandshakeRefusal(reply.refused)
    if HandshakeRefusal.VERSION in refused or reply.version != ours.version:
        return f"the board speaks protocol {reply.version} and this computer {ours.version}: flash its firmware again"
    if HandshakeRefusal.LAYOUT in refused or reply.layout_hash != ours.layout_hash:
        return (
            f"the board's messages have the layout {reply.layout_hash:08x} and this computer's {ours.layout_hash:08x}: "
            "flash the firmware that belongs to this version"
        )
    if reply.firmware_version >> 8 != FIRMWARE_VERSION >> 8:
        return (
            f"the board runs firmware {_version(reply.firmware_version)}, and {_version(FIRMWARE_VERSION)} is needed: "
            "flash the firmware that belongs to this version"
        )
    if HandshakeRefusal.CHAIR in refused or reply.chair_id != ours.chair_id:
        return (
            f"the board is built into chair '{_name(reply.chair_id)}' and this calibration is of chair "
            f"'{_name(ours.chair_id)}': load the calibration of this chair"
        )
    if HandshakeRefusal.FAMILY in refused or reply.family != ours.family:
        return (
            f"the board is made for joystick family {_family(reply.family)} and the computer is set to "
            f"{_family(ours.family)}: measure the chair with this board, since `waychair calibrate dac` keeps its family in the "
            f"chair's file; for a file without one set `bridge.family: {reply.family}` in the part chair of --config"
        )
    if refused or reply.swing_mv == 0 or reply.dac_high_mv <= reply.dac_low_mv or reply.dac_counts_max == 0:
        return "the board has no joystick family or impossible limits: configure and flash it again"
    return ""


def _version(number: int) -> str:
    return f"{number >> 8}.{number & 0xFF}"


def _family(number: int) -> str:
    """Return the number of a joystick family, and its name if it is known."""
    return f"{number} ({Family(number).name.lower()})" if number in set(Family) else str(number)


def _name(chair_id: bytes) -> str:
    return chair_id.rstrip(b"\0").decode(errors="replace")
