"""Messages between the chair's own nodes (package waychair_msgs): drive requests and reports, localisation, places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from waychair.control.safety.stops import halt
from waychair.control.safety.supervisor import DRIVEN
from waychair.errors import MessageError
from waychair.firmware_bridge.protocol import Holder
from waychair.recordings.bags.ros_messages import BASE_FRAME, MAP_FRAME, header, make
from waychair.ros.messages.motion import pose, read_pose, read_twist, twist
from waychair.ros.messages.wire import require_finite, require_frame, stamp_of
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import DriveMode, FloatArray, Place, Pose2, Twist

NO_GOAL = 0
"""The id that stands for no goal. The id of a goal is never reused."""


def goal_id_of(unique: Any) -> int:
    """Return the id of an action's goal, from its unique_identifier_msgs/UUID."""
    return int.from_bytes(bytes(unique.uuid)[:8], "little") or 1


@dataclass(frozen=True, slots=True)
class DriveRequest:
    """The navigator's request: `active` while there is a goal, `driving` while it commands speeds.

    `scan_ns`: stamp of the latest scan used in the decision; 0 for none. `goal`: the goal's pose in map. `stage`, `reason`
    and `plans` are those of `Navigation`. `last_goal`: why the last goal was refused or given up. `furniture` (N, 2) [m]:
    scan points that look like legs but are on the map, in the base frame at that scan. `floor_revision`: of the navigator's map.
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
    last_goal: str = ""
    floor_revision: int = 0


@dataclass(frozen=True, slots=True)
class DriveReport:
    """The bridge's report of a tick: drive mode, reason, goal and result.

    `command`: the command sent to the board, None while the lines are released. `drops_goal`: the goal is over. `ended`:
    why bridge or board ended a drive. `halts`: ids and sentences of the conditions that prevent a drive. `tilt`: the
    chair's roll and pitch [rad]. `scan_ns` and `goal`: from the request that the tick answers. `last_stop`: why the
    last drive ended, or did not begin. `last_goal`: why the navigator refused or gave up the last goal. `countdown_s`: time
    until the first motion of a confirmed drive, 0 for none. `steered`: a page's joystick drives. `pushed`: the rider pushes
    the chair's joystick.
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
    tilt: tuple[float, float] = (0.0, 0.0)
    scan_ns: int = 0
    goal: Pose2 = field(default_factory=Pose2)
    last_stop: str = ""
    countdown_s: float = 0.0
    steered: bool = False
    last_goal: str = ""
    pushed: bool = False

    @property
    def driving(self) -> bool:
        """Return whether the computer drives: to this goal, or by a page's joystick."""
        return self.mode in DRIVEN

    @property
    def waits(self) -> bool:
        """Return whether this goal waits for the rider's confirmation."""
        return self.reason == halt("unconfirmed").text


@dataclass(frozen=True, slots=True)
class Lines:
    """The voltages [V] of a simulated chair's joystick lines from `stamp_ns` on, and their holder."""

    stamp_ns: int
    holder: Holder
    forward: float
    turn: float


def drive_request(request: DriveRequest) -> Any:
    """Return a waychair_msgs/DriveRequest."""
    return make(
        "waychair_msgs/msg/DriveRequest",
        header=header(request.stamp_ns, BASE_FRAME),
        goal_id=request.goal_id,
        active=request.active,
        driving=request.driving,
        scan_ns=request.scan_ns,
        goal=pose(request.goal),
        stage=request.stage,
        reason=request.reason,
        plans=request.plans,
        furniture=np.ascontiguousarray(request.furniture, np.float32).ravel(),
        last_goal=request.last_goal,
        floor_revision=request.floor_revision,
    )


def read_drive_request(message: Any) -> DriveRequest:
    """Return the request of a waychair_msgs/DriveRequest.

    Raises:
        MessageError: an invalid goal pose, or invalid furniture coordinates.
    """
    furniture = np.asarray(message.furniture, np.float64)
    require_finite("a coordinate of furniture", *furniture.tolist())
    if len(furniture) % 2:
        raise MessageError(f"furniture has {len(furniture)} coordinates, which is odd: restart its sender")
    return DriveRequest(
        stamp_ns=stamp_of(message),
        goal_id=int(message.goal_id),
        active=bool(message.active),
        driving=bool(message.driving),
        scan_ns=int(message.scan_ns),
        goal=read_pose(message.goal),
        stage=str(message.stage),
        reason=str(message.reason),
        plans=int(message.plans),
        furniture=furniture.reshape(-1, 2),
        last_goal=str(message.last_goal),
        floor_revision=int(message.floor_revision),
    )


def drive_state(report: DriveReport) -> Any:
    """Return a waychair_msgs/DriveState."""
    command = report.command
    return make(
        "waychair_msgs/msg/DriveState",
        header=header(report.stamp_ns, BASE_FRAME),
        goal_id=report.goal_id,
        goal=pose(report.goal),
        mode=report.mode.value,
        reason=report.reason,
        drops_goal=report.drops_goal,
        ready=report.ready,
        commanded=command is not None,
        command=twist(command or Twist()),
        ended=report.ended,
        last_stop=report.last_stop,
        last_goal=report.last_goal,
        countdown=report.countdown_s,
        steered=report.steered,
        pushed=report.pushed,
        halts=[stop_id for stop_id, _ in report.halts],
        halt_texts=[text for _, text in report.halts],
        roll=report.tilt[0],
        pitch=report.tilt[1],
        scan_ns=report.scan_ns,
    )


def read_drive_state(message: Any) -> DriveReport:
    """Return the report of a waychair_msgs/DriveState.

    Raises:
        MessageError: an unknown mode, an invalid goal pose, or a value that is not finite.
    """
    require_finite("the chair's tilt or the countdown", message.roll, message.pitch, message.countdown)
    return DriveReport(
        stamp_ns=stamp_of(message),
        goal_id=int(message.goal_id),
        mode=_value(DriveMode, message.mode),
        reason=str(message.reason),
        drops_goal=bool(message.drops_goal),
        ready=bool(message.ready),
        command=read_twist(message.command) if message.commanded else None,
        ended=str(message.ended),
        halts=tuple(zip(message.halts, message.halt_texts, strict=False)),
        tilt=(float(message.roll), float(message.pitch)),
        scan_ns=int(message.scan_ns),
        goal=read_pose(message.goal),
        last_stop=str(message.last_stop),
        last_goal=str(message.last_goal),
        countdown_s=float(message.countdown),
        steered=bool(message.steered),
        pushed=bool(message.pushed),
    )


def lines(on_lines: Lines) -> Any:
    """Return a waychair_msgs/Lines."""
    head = header(on_lines.stamp_ns, BASE_FRAME)
    return make("waychair_msgs/msg/Lines", head, int(on_lines.holder), on_lines.forward, on_lines.turn)


def read_lines(message: Any) -> Lines:
    """Return the lines of a waychair_msgs/Lines.

    Raises:
        MessageError: an unknown holder, or a voltage that is not finite.
    """
    require_finite("a line's voltage", message.forward, message.turn)
    holder = _value(Holder, int(message.holder))
    return Lines(stamp_of(message), holder, float(message.forward), float(message.turn))


def localisation(stamp_ns: int, found: Localisation, refused_pose: str = "", floor_revision: int = 0) -> Any:
    """Return a waychair_msgs/Localisation; the candidate poses of a lost chair are not sent.

    `refused_pose` tells why the last initial pose was refused, `floor_revision` on which map the pose is.
    """
    covariance = np.full(9, np.nan) if found.covariance is None else np.ravel(found.covariance)
    return make(
        "waychair_msgs/msg/Localisation",
        header=header(stamp_ns, MAP_FRAME),
        map_from_odom=pose(found.map_from_odom),
        map_from_base=pose(found.map_from_base),
        remaining=pose(found.remaining),
        state=found.state.value,
        health=float(found.health),
        inliers=float(found.inliers),
        covariance=covariance.astype(np.float64),
        jumped=found.jumped,
        refused_pose=refused_pose,
        floor_revision=floor_revision,
    )


def read_localisation(message: Any) -> tuple[int, Localisation]:
    """Return the stamp [ns] of the scan and its localisation from a waychair_msgs/Localisation.

    Raises:
        MessageError: another frame, an unknown state, or a value that is not finite.
    """
    require_frame(message, MAP_FRAME)
    require_finite("a localisation's health", message.health, message.inliers)
    covariance = np.array(message.covariance, np.float64).reshape(3, 3)
    return stamp_of(message), Localisation(
        map_from_base=read_pose(message.map_from_base),
        map_from_odom=read_pose(message.map_from_odom),
        inliers=float(message.inliers),
        state=_value(LocalisationState, message.state),
        health=float(message.health),
        covariance=covariance if np.isfinite(covariance).all() else None,
        remaining=read_pose(message.remaining),
        jumped=bool(message.jumped),
    )


def read_localisation_on_floor(message: Any) -> tuple[int, Localisation, int]:
    """Return stamp and localisation as `read_localisation`, and the revision of the map on which the pose is.

    Raises:
        MessageError: as `read_localisation`.
    """
    return (*read_localisation(message), int(message.floor_revision))


def read_located(message: Any) -> tuple[int, Localisation, str]:
    """Return stamp and localisation as `read_localisation`, and why the last initial pose was refused.

    Raises:
        MessageError: as `read_localisation`.
    """
    return (*read_localisation(message), str(message.refused_pose))


def places(stamp_ns: int, named: Mapping[str, Place]) -> Any:
    """Return a waychair_msgs/Places."""
    listed = [
        make("waychair_msgs/msg/Place", place.name, pose(place.pose), place.tolerance_m, place.tolerance_rad)
        for place in named.values()
    ]
    return make("waychair_msgs/msg/Places", header(stamp_ns, MAP_FRAME), listed)


def read_places(message: Any) -> dict[str, Place]:
    """Return the places of a waychair_msgs/Places, by name.

    Raises:
        MessageError: another frame, or an invalid pose.
    """
    require_frame(message, MAP_FRAME)
    return {
        str(place.name): Place(
            str(place.name), read_pose(place.pose), float(place.tolerance_m), float(place.tolerance_rad)
        )
        for place in message.places
    }


def _value(kind: Any, text: str | int) -> Any:
    """Return the member of an enumeration.

    Raises:
        MessageError: the enumeration has no such value.
    """
    try:
        return kind(text)
    except ValueError as error:
        raise MessageError(f"'{text}' is no {kind.__name__}: update all nodes to one version") from error
