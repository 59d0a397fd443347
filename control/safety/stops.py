"""The table of all reasons for which the computer does not drive: cause, remedy, severity and braking.

A stop that is happening is a `Halt`: its row of the table and a sentence for the rider. The board's faults have rows
made from the board's own advice, so that no sentence is written twice.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from waychair.firmware_bridge.advice import FAULT_ADVICE, HOST_FAULTS


class Severity(enum.IntEnum):
    """The severity of a stop, by the steps needed to drive again, in rising order.

    REFUSES: no new drive begins, but one under way goes on. PAUSES: the chair stands and goes on by itself. ENDS: the
    drive is over and must be requested and confirmed again. LATCHES: a person must reset the fault first.
    """

    REFUSES = 0
    PAUSES = 1
    ENDS = 2
    LATCHES = 3


class Braking(enum.Enum):
    """The way in which a moving chair is brought to rest.

    COMFORT: within the comfort limits; EMERGENCY: as hard as the rider can bear; RELEASE: the lines are released at
    once, so that the chair's own controller brakes and the joystick is live.
    """

    COMFORT = "comfort"
    EMERGENCY = "emergency"
    RELEASE = "release"


@dataclass(frozen=True, slots=True)
class StopReason:
    """One row: `id` for logs and displays, the cause and the remedy in plain words, severity and braking."""

    id: str
    sentence: str
    remedy: str
    severity: Severity
    braking: Braking


@dataclass(frozen=True, slots=True)
class Halt:
    """A stop that is happening; `text` is its sentence with figures and remedy."""

    stop: StopReason
    text: str


_REFUSES, _PAUSES, _ENDS, _LATCHES = Severity
_COMFORT, _EMERGENCY, _RELEASE = Braking


def _board_stops() -> Iterable[StopReason]:
    """Yield the stops of the board's own faults; the board has released the lines before it reports one."""
    for fault, advice in FAULT_ADVICE.items():
        sentence, _, remedy = advice.partition(": ")
        severity = _ENDS if fault in HOST_FAULTS else _LATCHES
        yield StopReason(f"board_{str(fault.name).lower()}", sentence, remedy, severity, _RELEASE)


_ROWS: tuple[StopReason, ...] = (
    StopReason("stop_pressed", "Stop was pressed", "ask for a goal again to drive on", _ENDS, _RELEASE),
    StopReason("taken_over", "the rider drives by joystick", "ask for a goal again to drive on", _ENDS, _RELEASE),
    StopReason("unconfirmed", "nobody has confirmed the drive", "press Drive to begin it", _REFUSES, _COMFORT),
    StopReason("seat_empty", "nobody sits in the chair", "sit down, then ask for the goal again", _ENDS, _COMFORT),
    StopReason("charging", "the charger is connected", "unplug it, then ask for the goal again", _ENDS, _RELEASE),
    StopReason("battery_low", "the battery is low", "drive to the charger by joystick", _REFUSES, _COMFORT),
    StopReason(
        "status_stale",
        "seat switch, battery and charger are silent",
        "check the cable of the chair's contacts",
        _ENDS,
        _COMFORT,
    ),
    StopReason("lidar_stale", "the lidar is silent", "check its cable and power", _ENDS, _EMERGENCY),
    StopReason(
        "lidar_late", "the last scan is too old to drive by", "wait; if it lasts, check the lidar", _PAUSES, _EMERGENCY
    ),
    StopReason("lidar_slow", "the lidar sends too few scans", "set its rate of scans higher", _ENDS, _EMERGENCY),
    StopReason(
        "lidar_delayed",
        "the lidar's scans arrive too late",
        "see what holds them up, such as filters of its driver or the network",
        _ENDS,
        _EMERGENCY,
    ),
    StopReason(
        "lidar_clock",
        "the lidar's scans are stamped by another clock",
        "set that clock, or let its driver stamp scans as they arrive",
        _ENDS,
        _EMERGENCY,
    ),
    StopReason(
        "lidar_blind", "the lidar sees too little", "clean its window and take off what covers it", _ENDS, _EMERGENCY
    ),
    StopReason("lidar_frozen", "the lidar repeats one scan", "switch it off and on", _ENDS, _EMERGENCY),
    StopReason("wheels_stale", "the wheel encoders are silent", "check their cable", _ENDS, _RELEASE),
    StopReason(
        "wheels_delayed",
        "the wheel encoders' readings arrive too late",
        "see what holds them up, or whether their stamps are of another clock",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "computer_slow",
        "the computer does not keep up",
        "end other programs on it, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason("imu_stale", "the IMU is silent", "check its cable", _ENDS, _COMFORT),
    StopReason("depth_stale", "the depth camera is silent", "check its cable", _ENDS, _COMFORT),
    StopReason(
        "own_parts",
        "the lidar sees the chair itself, such as its footrests or the rider's legs",
        "hide these from it by `waychair calibrate mask`, then ask for the goal again",
        _ENDS,
        _EMERGENCY,
    ),
    StopReason(
        "near_parts",
        "something is within a hand's breadth of the chair",
        "take it away, or hide it by `waychair calibrate mask` if it belongs to the chair",
        _PAUSES,
        _COMFORT,
    ),
    StopReason(
        "near_parts_stay",
        "something stays within a hand's breadth of the chair",
        "take it away, or hide it by `waychair calibrate mask` if it belongs to the chair, then ask for the goal again",
        _ENDS,
        _COMFORT,
    ),
    StopReason("fleet_waits", "another chair goes first", "wait; the drive goes on by itself", _PAUSES, _COMFORT),
    StopReason("obstacle", "something is close ahead", "wait, or have the way cleared", _PAUSES, _EMERGENCY),
    StopReason(
        "monitor_silent",
        "the collision monitor does not answer",
        "press Reset, which starts it again, then ask for the goal again",
        _LATCHES,
        _EMERGENCY,
    ),
    StopReason(
        "lost",
        "the chair no longer knows where it is",
        "drive it to a known place and set its pose",
        _ENDS,
        _COMFORT,
    ),
    StopReason(
        "unplaced",
        "the scans do not show where the chair stands; it may have been moved while it was switched off",
        "set its pose, or drive it some metres by joystick, so that it finds its place",
        _ENDS,
        _COMFORT,
    ),
    StopReason(
        "pose_jump",
        "the chair found itself elsewhere on the map",
        "see whether the map shows it right, then ask for the goal again",
        _ENDS,
        _COMFORT,
    ),
    StopReason(
        "pushed",
        "the chair is being pushed by hand",
        "once it stands, see whether the map shows it right, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "page_gone",
        "no page with a Stop button answers any more",
        "open the page again, then ask for the goal again",
        _ENDS,
        _COMFORT,
    ),
    StopReason("tilt", "the floor is too steep", "drive to level ground by joystick", _ENDS, _COMFORT),
    StopReason(
        "disobeys", "the chair does not follow its commands", "have it checked, then press Reset", _LATCHES, _RELEASE
    ),
    StopReason(
        "navigator_silent",
        "the navigator does not answer",
        "wait until it is back, then request the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "localiser_silent",
        "the localisation does not answer",
        "wait until the map and the pose are back, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "floor_differs",
        "the chair's nodes have the maps of different storeys",
        "wait until they have one map, or restart the node that lacks it, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "floor_uncertain",
        "the chair is in a lift or has left one, and its storey is not certain",
        "wait, or say which storey it is",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "two_commanders",
        "another program commands the chair, too",
        "stop the other publisher of speeds, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "open_network",
        "anybody on the network could command the chair",
        "set up security keys (SROS 2), or start it without --lan",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "stick_touched",
        "the joystick is not at rest",
        "let go of it, and the drive begins two seconds later",
        _PAUSES,
        _COMFORT,
    ),
    StopReason(
        "stick_off_rest",
        "the joystick does not come to rest",
        "let go of it, or have it checked if nobody touches it, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason(
        "never_armed",
        "the board does not take up the drive",
        "let go of the joystick and see whether the chair is switched on, then ask for the goal again",
        _ENDS,
        _RELEASE,
    ),
    StopReason("board_unusable", "the board cannot be driven through", "check its cable and power", _ENDS, _RELEASE),
)

STOPS: Mapping[str, StopReason] = MappingProxyType({stop.id: stop for stop in (*_ROWS, *_board_stops())})
"""All stops by id."""

BY_MAP_ONLY = frozenset(
    {
        "lost",
        "unplaced",
        "pose_jump",
        "pushed",
        "navigator_silent",
        "localiser_silent",
        "floor_differs",
        "floor_uncertain",
        "page_gone",
    }
)
"""Ids of stops that concern drives to a goal on a map only; they do not stop a person that steers by a joystick."""

_BY_ADVICE: Mapping[str, StopReason] = MappingProxyType(
    {advice: STOPS[f"board_{str(fault.name).lower()}"] for fault, advice in FAULT_ADVICE.items()}
)


def halt(stop_id: str, detail: str = "") -> Halt:
    """Return a stop of the table as a halt, with figures if there are any."""
    stop = STOPS[stop_id]
    return Halt(stop, f"{stop.sentence}{f' ({detail})' if detail else ''}: {stop.remedy}")


def halt_as_told(stop_id: str, text: str) -> Halt:
    """Return a halt with another part's own sentence, which includes a remedy."""
    return Halt(STOPS[stop_id], text)


def board_halt(advice: str) -> Halt:
    """Return the halt for the bridge's advice about the board or its cable."""
    return Halt(_BY_ADVICE.get(advice, STOPS["board_unusable"]), advice)


def gravest(halts: Iterable[Halt]) -> Halt | None:
    """Return the halt of the highest severity, the first of equals; None without halts."""
    return max(halts, key=lambda halted: halted.stop.severity, default=None)
