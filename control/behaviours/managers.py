"""The Sensor command manager (paper 3.4) and the Navigation command manager (paper 3.5).

The Sensor command manager gives the camera to one client at a time, by fixed priority and at once, like an interrupt:
Object tracker, Range finder of the door, Way finder. The loser's request is dropped; it asks again. A grant counts when
the servos report that they have settled at its angle.

The Navigation command manager makes one signal of Command_door, Command_free and Command_obs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import (
    SECTORS,
    DoorCommand,
    FreeCommand,
    FreeKind,
    Move,
    Signal,
    SignalKind,
    between,
    sector_of,
)
from waychair.control.behaviours.doorway import DoorCheck, TrackedDoor
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.paper_settings import CameraLimits, NavigationLimits
from waychair.control.behaviours.range_finder import PRIORITY, CameraAim, LookRequest, SensorCommand
from waychair.control.behaviours.sonar import Obstacle, ObstacleClasses

NOT_HEARD = "no sonar is heard"
"""Reason of the warning where nothing is known of obstacles."""


@dataclass(frozen=True, slots=True)
class GrantMemory:
    """Dynamic data of the Sensor command manager: the order before, and since when the camera was sent there."""

    command: SensorCommand | None = None
    since_ns: int = 0


def grant(
    tracker: Reading[TrackedDoor] | None,
    door_range: Reading[DoorCheck] | None,
    way_finder: Reading[WayFound] | None,
    aim: CameraAim | None,
    constants: CameraLimits,
    dynamic: GrantMemory,
    now_ns: int,
) -> tuple[SensorCommand | None, GrantMemory]:
    """Return the order of the most important client that is active; None if none asks.

    A camera that has not come to rest at its angle within the patience gives a fault, and so does one without a report.
    """
    clients = (tracker, door_range, way_finder)
    requests = (each.value.request if each is not None and each.active else None for each in clients)
    asked = zip(PRIORITY, requests, strict=True)
    chosen = next(((client, request) for client, request in asked if request is not None), None)
    if chosen is None:
        return None, GrantMemory()
    client, request = chosen
    before = dynamic.command
    same = before is not None and (before.client, before.pan, before.tilt) == (client, request.pan, request.tilt)
    since_ns = dynamic.since_ns if same else now_ns
    there = (
        aim is not None
        and aim.settled
        and abs(aim.pan - servo_pan(request.pan)) <= constants.aimed
        and abs(aim.tilt - request.tilt) <= constants.aimed
    )
    late = not there and now_ns - since_ns > round(constants.patience * 1e9)
    command = SensorCommand(client, request.pan, request.tilt, there, _aim_fault(aim, request) if late else "")
    return command, GrantMemory(command, since_ns)


def servo_pan(angle: float) -> float:
    """Return a direction as an angle of the pan servo [rad], 0 to 2 pi to the left: it does not wrap."""
    return angle % math.tau


def _aim_fault(aim: CameraAim | None, request: LookRequest) -> str:
    wanted = f"{math.degrees(servo_pan(request.pan)):.0f} degrees"
    if aim is None:
        return f"the camera's servos do not report their angles, so nobody looks to {wanted}: see their cable"
    return f"the camera stands at {math.degrees(aim.pan):.0f} degrees and does not reach {wanted}: see its servos"


def aim_servos(effect: SensorCommand) -> tuple[float, float]:
    """Return the order to the servos: pan in [0, 2 pi) and tilt [rad]."""
    return servo_pan(effect.pan), effect.tilt


def light_laser(effect: SensorCommand) -> bool:
    """Return whether the laser line is to be on: while somebody ranges."""
    return not effect.fault


def inhibit() -> bool:
    """Return true: the cell's activation is its message, an inhibitory signal to Free-space finding."""
    return True


@dataclass(frozen=True, slots=True)
class GatedSignals:
    """Command_free behind `gate_signals`: each way has it or None."""

    to_select: FreeCommand | None
    to_merge: FreeCommand | None


def gate_signals(way: WayFound) -> GatedSignals:
    """Return a stop for `select_signal` only, a null code for `merge_commands` only, a list for both."""
    free = way.command
    return GatedSignals(
        free if free.kind is not FreeKind.NULL else None,
        free if free.kind is not FreeKind.STOP else None,
    )


@dataclass(frozen=True, slots=True)
class StickDirection:
    """The rider's stick: forward and turn (to the left), each in [-1, 1]."""

    forward: float
    turn: float


def select_signal(
    gated: GatedSignals, obstacles: ObstacleClasses | None, stick: StickDirection | None, constants: NavigationLimits
) -> Signal | None:
    """Return the stop warning, or the fittest orientation where more than two obstacles are immediate.

    The fittest is nearest to where the stick points, else to straight ahead; of two, the one in the wider free part.
    """
    free = gated.to_select
    if free is None:
        return None
    if free.kind is FreeKind.STOP:
        return Signal(SignalKind.WARNING, "no way is free")
    if obstacles is None or obstacles.immediate() < constants.surrounded or not free.orientations:
        return None
    chosen = nearest_orientation(free.orientations, stick_angle(stick, constants), free.sectors)
    return Signal(SignalKind.DIRECTION, "surrounded", Move.GO, chosen)


def stick_angle(stick: StickDirection | None, limits: NavigationLimits) -> float:
    """Return where the stick points [rad]; straight ahead at rest."""
    if stick is None or not math.hypot(stick.forward, stick.turn) >= limits.stick:
        return 0.0
    return math.atan2(stick.turn, stick.forward)


def nearest_orientation(free: tuple[float, ...], wanted: float, sectors: int = SECTORS) -> float:
    """Return the free orientation nearest to a wanted one; of equal ones that in the wider part, then the left one."""

    def order(angle: float) -> tuple[float, int, float]:
        return round(between(angle, wanted), 9), -free_width(free, angle, sectors), -angle

    return min(free, key=order)


def free_width(free: tuple[float, ...], angle: float, count: int) -> int:
    """Return the number of neighbouring free sectors around one."""
    sectors = {sector_of(each, count) for each in free}
    here, width = sector_of(angle, count), 1
    for step in (1, -1):
        k = here + step
        while k % count in sectors and width < count:
            width, k = width + 1, k + step
    return width


def merge_commands(gated: GatedSignals, door: DoorCommand, constants: NavigationLimits) -> Signal | None:
    """Return Command_door, or with a list the free orientation nearest to the door's; a stop if none is near."""
    free = gated.to_merge
    if free is None or door.move is Move.DONE:
        return None
    if free.kind is FreeKind.NULL:
        return Signal(SignalKind.DIRECTION, "door", door.move, door.orientation)
    nearest = nearest_orientation(free.orientations, door.orientation, free.sectors)
    if round(between(nearest, door.orientation) - constants.agreeing, 9) > 0.0:
        return Signal(SignalKind.WARNING, "door blocked")
    return Signal(SignalKind.DIRECTION, "door", door.move, door.orientation if door.move is Move.SWIVEL else nearest)


def choose_signal(
    obstacles: ObstacleClasses | None,
    selected: Signal | None,
    merged: Reading[Signal] | None,
    constants: NavigationLimits,
    now_ns: int,
) -> Signal:
    """Return the one signal that is sent: a stop warning above all, then a fresh merged command, then a selected one.

    Without these it is Command_obs. Where no sonar is heard, there is nothing to tell but to stop.
    """
    fresh = merged is not None and merged.active and now_ns - merged.stamp_ns <= round(constants.merged * 1e9)
    door = merged.value if fresh and merged is not None else None
    for signal in (selected, door):
        if signal is not None and signal.kind is SignalKind.WARNING:
            return signal
    if door is not None:
        return door
    if selected is not None:
        return selected
    if obstacles is None or not obstacles.known:
        return Signal(SignalKind.WARNING, NOT_HEARD)
    return Signal(SignalKind.SPACE, _near_words(obstacles), classes=tuple(int(each) for each in obstacles.classes))


def _near_words(obstacles: ObstacleClasses) -> str:
    nearest = max(obstacles.classes)
    count = sum(each is nearest for each in obstacles.classes)
    return "" if nearest <= Obstacle.FAR else f"{count} {nearest.name.lower()}"
