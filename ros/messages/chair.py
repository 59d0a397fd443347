"""What the chair's own nodes say to each other, in messages of the package waychair_msgs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from waychair.control.stops import halt
from waychair.control.supervisor import DRIVEN
from waychair.errors import MessageError
from waychair.firmware_bridge.protocol import Holder
from waychair.ros.messages.motion import pose, read_pose, read_twist, twist
from waychair.ros.messages.wire import require_finite, require_frame, stamp_of
from waychair.ros_messages import BASE_FRAME, MAP_FRAME, header, make
from waychair.slam.localisation import Localisation, LocalisationState
from waychair.types import DriveMode, FloatArray, Place, Pose2, Twist

NO_GOAL = 0
"""The id of no goal; that of a goal is never used again."""


def goal_id_of(unique: Any) -> int:
    """The id of an action's goal, from its unique_identifier_msgs/UUID."""
    return int.from_bytes(bytes(unique.uuid)[:8], "little") or 1


@dataclass(frozen=True, slots=True)
class DriveRequest:
    """What the navigator wants: `active` while there is a goal to reach, `driving` while it asks for speeds.

    `scan_ns`: stamp of the latest scan by which that was decided; 0 without one. `goal` is where that goal lies in map;
    stage, reason and plans are the `Navigation`'s. `furniture` (N, 2) [m] in the base
    of that scan: what in it might be legs but is on the map.
    """

    stamp_ns: int
    goal_id: int = NO_GOAL
    active: bool = False
    driving: bool = False
    scan_ns: int = 0
    goal: Pose2 = field(default_factory=Pose2)
    stage: str = "idle"
    reason: str = ""
    plans: int = 0
    furniture: FloatArray = field(default_factory=lambda: np.empty((0, 2)), compare=False)


@dataclass(frozen=True, slots=True)
class DriveReport:
    """Who drives in a tick of the bridge and why, of which goal, and what came of it.

    `command` is what was sent, None while the lines are let go. `drops_goal`: that goal is over. `ended`: why bridge or
    board ended a drive. `halts` are ids and sentences of what stands against a drive. The chair leans by `roll` and
    `pitch` [rad]. `scan_ns` is that of the request it answers, `goal` where its goal lies in map. `last_stop`: why the
    last drive was over, or did not begin. `countdown_s`: until the first motion of a drive that has begun, 0 when none is
    about to begin. `steered`: a page's joystick drives.
    """

    stamp_ns: int
    goal_id: int
    mode: DriveMode
    reason: str = ""
    drops_goal: bool = False
    ready: bool = False
    command: Twist | None = None
    ended: str = ""
    halts: tuple[tuple[str, str], ...] = field(default=())
    roll: float = 0.0
    pitch: float = 0.0
    scan_ns: int = 0
    goal: Pose2 = field(default_factory=Pose2)
    last_stop: str = ""
    countdown_s: float = 0.0
    steered: bool = False

    @property
    def driving(self) -> bool:
        """Whether the computer drives: to this goal, or as a page's joystick says."""
        return self.mode in DRIVEN

    @property
    def waits(self) -> bool:
        """Whether this goal waits for the rider's yes."""
        return self.reason == halt("unconfirmed").text


@dataclass(frozen=True, slots=True)
class Lines:
    """What is on a simulated chair's joystick lines [V] from `stamp_ns` on, and who holds them."""

    stamp_ns: int
    holder: Holder
    forward: float
    turn: float


def drive_request(request: DriveRequest) -> Any:
    """waychair_msgs/DriveRequest."""
    head = header(request.stamp_ns, BASE_FRAME)
    flags = request.active, request.driving
    way = pose(request.goal), request.stage, request.reason, request.plans
    furniture = np.ascontiguousarray(request.furniture, np.float32).ravel()
    return make("waychair_msgs/msg/DriveRequest", head, request.goal_id, *flags, request.scan_ns, *way, furniture)


def read_drive_request(message: Any) -> DriveRequest:
    """Of a waychair_msgs/DriveRequest.

    Raises:
        MessageError: a goal that is no pose, or furniture at no place.
    """
    furniture = np.asarray(message.furniture, np.float64)
    require_finite("the place of furniture", *furniture.tolist())
    if len(furniture) % 2:
        raise MessageError(f"furniture has {len(furniture)} coordinates, which is odd: restart what sends it")
    return DriveRequest(
        stamp_of(message),
        int(message.goal_id),
        bool(message.active),
        bool(message.driving),
        int(message.scan_ns),
        read_pose(message.goal),
        str(message.stage),
        str(message.reason),
        int(message.plans),
        furniture.reshape(-1, 2),
    )


def drive_state(report: DriveReport) -> Any:
    """waychair_msgs/DriveState."""
    command = report.command
    return make(
        "waychair_msgs/msg/DriveState",
        header(report.stamp_ns, BASE_FRAME),
        report.goal_id,
        pose(report.goal),
        report.mode.value,
        report.reason,
        report.drops_goal,
        report.ready,
        command is not None,
        twist(command or Twist()),
        report.ended,
        report.last_stop,
        report.countdown_s,
        report.steered,
        [stop_id for stop_id, _ in report.halts],
        [text for _, text in report.halts],
        report.roll,
        report.pitch,
        report.scan_ns,
    )


def read_drive_state(message: Any) -> DriveReport:
    """Of a waychair_msgs/DriveState.

    Raises:
        MessageError: a mode that there is not, a goal that is no pose, or what is no number.
    """
    require_finite("the chair's lean and the countdown", message.roll, message.pitch, message.countdown)
    return DriveReport(
        stamp_of(message),
        int(message.goal_id),
        _value(DriveMode, message.mode),
        str(message.reason),
        bool(message.drops_goal),
        bool(message.ready),
        read_twist(message.command) if message.commanded else None,
        str(message.ended),
        tuple(zip(message.halts, message.halt_texts, strict=False)),
        float(message.roll),
        float(message.pitch),
        int(message.scan_ns),
        read_pose(message.goal),
        str(message.last_stop),
        float(message.countdown),
        bool(message.steered),
    )


def lines(on_lines: Lines) -> Any:
    """waychair_msgs/Lines."""
    head = header(on_lines.stamp_ns, BASE_FRAME)
    return make("waychair_msgs/msg/Lines", head, int(on_lines.holder), on_lines.forward, on_lines.turn)


def read_lines(message: Any) -> Lines:
    """Of a waychair_msgs/Lines.

    Raises:
        MessageError: nobody of that name can hold them, or what is no number.
    """
    require_finite("a line's voltage", message.forward, message.turn)
    holder = _value(Holder, int(message.holder))
    return Lines(stamp_of(message), holder, float(message.forward), float(message.turn))


def localisation(stamp_ns: int, found: Localisation) -> Any:
    """waychair_msgs/Localisation; candidates of a lost chair stay behind."""
    covariance = np.full(9, np.nan) if found.covariance is None else np.ravel(found.covariance)
    return make(
        "waychair_msgs/msg/Localisation",
        header(stamp_ns, MAP_FRAME),
        pose(found.map_from_odom),
        pose(found.map_from_base),
        pose(found.remaining),
        found.state.value,
        float(found.health),
        float(found.inliers),
        covariance.astype(np.float64),
        found.jumped,
    )


def read_localisation(message: Any) -> tuple[int, Localisation]:
    """Stamp of the scan [ns] and what is known by it, of a waychair_msgs/Localisation.

    Raises:
        MessageError: another frame, a state that there is not, or what is no number.
    """
    require_frame(message, MAP_FRAME)
    require_finite("a localisation's health", message.health, message.inliers)
    covariance = np.array(message.covariance, np.float64).reshape(3, 3)
    return stamp_of(message), Localisation(
        read_pose(message.map_from_base),
        read_pose(message.map_from_odom),
        float(message.inliers),
        _value(LocalisationState, message.state),
        float(message.health),
        covariance if np.isfinite(covariance).all() else None,
        read_pose(message.remaining),
        bool(message.jumped),
    )


def places(stamp_ns: int, named: Mapping[str, Place]) -> Any:
    """waychair_msgs/Places."""
    listed = [
        make("waychair_msgs/msg/Place", place.name, pose(place.pose), place.tolerance_m, place.tolerance_rad)
        for place in named.values()
    ]
    return make("waychair_msgs/msg/Places", header(stamp_ns, MAP_FRAME), listed)


def read_places(message: Any) -> dict[str, Place]:
    """By name, of a waychair_msgs/Places.

    Raises:
        MessageError: another frame, or what is no pose.
    """
    require_frame(message, MAP_FRAME)
    return {
        str(place.name): Place(
            str(place.name), read_pose(place.pose), float(place.tolerance_m), float(place.tolerance_rad)
        )
        for place in message.places
    }


def _value(kind: Any, text: str | int) -> Any:
    """The member of an enumeration.

    Raises:
        MessageError: there is none.
    """
    try:
        return kind(text)
    except ValueError as error:
        raise MessageError(f"'{text}' is no {kind.__name__}: update all nodes to one version") from error
