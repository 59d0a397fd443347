"""The cells of the camera on servos with its laser's line: what the line shows, and who aims the camera.

The line lies in one plane at the height of the laser. It tells of things that a lidar passes under, and frees no ground:
below and above its plane nobody has looked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.doorway import DoorCheck, TrackedDoor
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.managers import GrantMemory, grant
from waychair.control.behaviours.paper_settings import CameraLimits
from waychair.control.behaviours.range_finder import (
    PRIORITY,
    WAY_FINDER,
    CameraAim,
    Depth,
    LookRequest,
    SensorCommand,
)
from waychair.control.behaviours.view.local_view import Beams, Fans

SWEEP = (0.0, math.radians(35.0), 0.0, math.radians(-35.0))
"""rad; the ways into which the camera looks in turn while nobody else wants it: ahead, and to both sides of it."""

_SHOWN_NS = 1_000_000_000
"""A camera at rest that shows no line for so long looks elsewhere: on black or far things there is none."""

_FAILED_NS = 5_000_000_000
"""Time for which an order that the camera did not carry out is named: long enough to be read or spoken."""

_HALF_COLUMN = 0.5 / SERVO_CAMERA.focal
"""rad; half the angle between two columns of the picture."""


def servo_camera_limits(limits: CameraLimits) -> CameraLimits:
    """Return the limits with the optics and the place of this chair's camera on servos."""
    matrix = SERVO_CAMERA.camera_matrix
    return replace(
        limits,
        focal=SERVO_CAMERA.focal,
        middle_column=float(matrix[0, 2]),
        middle_row=float(matrix[1, 2]),
        baseline=SERVO_CAMERA.baseline,
        forward=SERVO_CAMERA.forward,
        left=SERVO_CAMERA.left,
    )


def line_fans(depth: Depth, constants: CameraLimits) -> Fans:
    """Return the lit points as a fan from the camera."""
    origin = np.array([constants.forward, constants.left])
    ends = depth.metres[:, None] * np.column_stack([np.cos(depth.bearings), np.sin(depth.bearings)])
    return Fans((Beams(origin, ends.astype(np.float32), np.ones(len(ends), np.bool_), _HALF_COLUMN),))


@dataclass(frozen=True, slots=True)
class CameraOrder(SensorCommand):
    """The camera's order, and the clients that ask for it in vain, the most important first.

    `failed` is the fault of an order that was not carried out a short while ago; its client has gone on since.
    """

    waiting: tuple[str, ...] = ()
    failed: str = ""


@dataclass(frozen=True, slots=True)
class ShareMemory:
    """Dynamic data of the sharing: that of the grant, and the latest fault with its stamp."""

    grant: GrantMemory = field(default_factory=GrantMemory)
    failed: str = ""
    failed_ns: int = 0


def share_camera(
    tracker: Reading[TrackedDoor] | None,
    door_range: Reading[DoorCheck] | None,
    way_finder: Reading[WayFound] | None,
    aim: Reading[CameraAim] | None,
    constants: CameraLimits,
    dynamic: ShareMemory,
    now_ns: int,
) -> tuple[CameraOrder | None, ShareMemory]:
    """Return the paper's grant, and the clients that have to wait; None on a chair without a camera on servos."""
    if aim is None:
        return None, dynamic
    reported = aim.value if now_ns - aim.stamp_ns <= round(constants.fresh * 1e9) else None
    command, memory = grant(tracker, door_range, way_finder, reported, constants, dynamic.grant, now_ns)
    if command is None:
        return None, replace(dynamic, grant=memory)
    asking = [
        client
        for client, each in zip(PRIORITY, (tracker, door_range, way_finder), strict=True)
        if each is not None and each.active and each.value.request is not None
    ]
    waiting = tuple(client for client in asking if client != command.client)
    failed, failed_ns = (command.fault, now_ns) if command.fault else (dynamic.failed, dynamic.failed_ns)
    if now_ns - failed_ns > _FAILED_NS:
        failed = ""
    order = CameraOrder(command.client, command.pan, command.tilt, command.settled, command.fault, waiting, failed)
    return order, ShareMemory(memory, failed, failed_ns)


@dataclass(frozen=True, slots=True)
class SweepMemory:
    """Dynamic data of the sweep: the number of the present way in `SWEEP`, and since when the camera rests there."""

    turn: int = 0
    settled_ns: int | None = None


def swept_look(
    seen_ns: int | None, granted: SensorCommand | None, memory: SweepMemory, now_ns: int
) -> tuple[LookRequest, SweepMemory]:
    """Return the way into which the Way finder wants to look, the next one after the line was seen in the present one.

    `seen_ns` is the stamp of the line's latest look, None before the first. A way that the camera does not reach is passed over.
    """
    request = LookRequest(SWEEP[memory.turn])
    mine = granted is not None and granted.client == WAY_FINDER and granted.pan == request.pan
    if not mine or granted is None:
        return request, SweepMemory(memory.turn)
    if not granted.settled and not granted.fault:
        return request, SweepMemory(memory.turn)
    since_ns = now_ns if memory.settled_ns is None else memory.settled_ns
    shown = seen_ns is not None and seen_ns > since_ns
    if granted.fault or shown or now_ns - since_ns > _SHOWN_NS:
        turn = (memory.turn + 1) % len(SWEEP)
        return LookRequest(SWEEP[turn]), SweepMemory(turn)
    return request, SweepMemory(memory.turn, since_ns)
