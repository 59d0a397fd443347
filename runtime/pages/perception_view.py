"""The page's view of the behaviour cells: cells with their effects in words, free directions, doorways, the camera's aim.

All sentences are made here, so that drawing and text of a page say the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.cell_network import Network, Node, Wiring
from waychair.control.behaviours.commands import (
    DoorCommand,
    FreeCommand,
    FreeKind,
    Signal,
    between,
    move_words,
    signal_words,
)
from waychair.control.behaviours.doorway import DoorCheck, OdometryPose, TrackedDoor
from waychair.control.behaviours.drawing import network_picture
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.managers import GatedSignals
from waychair.control.behaviours.range_finder import Depth, SensorCommand
from waychair.control.behaviours.runtime import PortState
from waychair.control.behaviours.sonar import Obstacle, ObstacleClasses
from waychair.control.behaviours.view.door_cells import DoorSeen
from waychair.control.behaviours.view.sensor_cells import SensorTroubles
from waychair.control.behaviours.view.servo_cells import CameraOrder
from waychair.geometry import wrap_angle
from waychair.planning.seen.doorways import SPARE, DoorState, Doorway
from waychair.runtime.haptics.haptic_state import RiderSurroundings
from waychair.runtime.perception import Perceived
from waychair.types import PanTiltAngles, Place, Pose2

FARTHEST_DOORWAY = 8.0
"""m; doorways farther away are not shown."""


@dataclass(frozen=True, slots=True)
class CellView:
    """One cell or network: its `depth` in the networks, whether it is active or inhibited, its effect in words, and age.

    `age_s` is that of the effect, None before the first. `fault`: why the cell is inactive; empty otherwise.
    """

    name: str
    is_network: bool
    depth: int
    active: bool
    inhibited: bool
    words: str
    age_s: float | None
    fault: str


@dataclass(frozen=True, slots=True)
class SectorsView:
    """The free orientations [rad] of `count` sectors, and the same as a sentence; `looked`: somebody looked for them."""

    count: int
    free: tuple[float, ...]
    looked: bool
    words: str


@dataclass(frozen=True, slots=True)
class DoorwayView:
    """A doorway: its middle x, y [m] and way through `theta` [rad] in base, clear width [m], state, and a sentence.

    `clear` [m] of the width is seen free. `wide_enough` is of this chair.
    """

    number: int
    x: float
    y: float
    theta: float
    width: float
    clear: float
    state: str
    wide_enough: bool
    words: str


@dataclass(frozen=True, slots=True)
class AimView:
    """Where the camera on servos looks: pan to the left and tilt up [rad], whether it is at rest, and a sentence."""

    pan: float
    tilt: float
    settled: bool
    words: str


@dataclass(frozen=True, slots=True)
class PerceptionView:
    """The behaviour cells of a chair at `stamp_ns`; `networks` are those that can be drawn, the whole one first.

    `signal`: the signal to the rider in words, `told`: itself, for a glove.
    """

    stamp_ns: int
    signal: str
    networks: tuple[str, ...]
    cells: tuple[CellView, ...]
    sectors: SectorsView
    doorways: tuple[DoorwayView, ...] = ()
    aim: AimView | None = None
    troubles: tuple[str, ...] = ()
    told: Signal | None = None


_MOST_DOORWAYS = 2
"""More doorways in one answer are not remembered."""


def surroundings(places: Mapping[str, Place], seen: PerceptionView | None) -> RiderSurroundings:
    """Return the facts of a chair's place: its map's places, and the finds of the behaviour cells near it."""
    near = () if seen is None else (seen.sectors.words, *(each.words for each in seen.doorways[:_MOST_DOORWAYS]))
    return RiderSurroundings(tuple(places.values()), near)


def shown_doorways(seen: PerceptionView, odom_from_base: Pose2) -> tuple[Doorway, ...]:
    """Return the doorways of a view in odom, from the chair's pose at its stamp."""
    return tuple(_shown_doorway(each, odom_from_base) for each in seen.doorways)


def _shown_doorway(shown: DoorwayView, odom_from_base: Pose2) -> Doorway:
    """Return the doorway of a view; only candidates are of unknown state."""
    pose, state = odom_from_base @ Pose2(shown.x, shown.y, shown.theta), DoorState(shown.state)
    return Doorway(shown.number, pose, shown.width, shown.clear, 0.0, state, validated=state is not DoorState.UNKNOWN)


class WithoutCells:
    """The part of a `ChairPort` that shows behaviour cells, for a chair that has none."""

    def perception(self) -> PerceptionView | None:
        """See `ChairPort`."""
        return None

    def network(self, name: str) -> str | None:
        """See `ChairPort`."""
        return None


def perception_view(perceived: Perceived, body: ChairBody, aim: PanTiltAngles | None = None) -> PerceptionView:
    """Return the page's view of the cells after a tick."""
    wiring, done = perceived.network.wiring, perceived.done
    at = perceived.heard.get("odometry")
    doorways: tuple[DoorwayView, ...] = ()
    if isinstance(at, OdometryPose):  # without a pose nobody knows where they are by now
        near = (_doorway_view(each, at.pose(), body) for each in perceived.doorways)
        found = (each for each in near if math.hypot(each.x, each.y) <= FARTHEST_DOORWAY)
        doorways = tuple(sorted(found, key=lambda each: math.hypot(each.x, each.y)))
    return PerceptionView(
        stamp_ns=done.stamp_ns,
        signal=perceived.signal or "no signal",
        networks=tuple(name for name, node in wiring.nodes.items() if isinstance(node, Network)),
        cells=tuple(_cells(wiring, done.ports, done.stamp_ns)),
        sectors=_sectors(done.ports),
        doorways=doorways,
        aim=None if aim is None else _aim_view(aim, done.ports["grant"].eo if "grant" in done.ports else None),
        troubles=perceived.troubles,
        told=perceived.told,
    )


def drawn_network(perceived: Perceived, name: str) -> str | None:
    """Return the picture (SVG) of one of the chair's networks; None if there is none of this name."""
    wiring = perceived.network.wiring
    return network_picture(wiring, name) if isinstance(wiring.nodes.get(name), Network) else None


def _cells(wiring: Wiring, ports: Mapping[str, PortState], now_ns: int) -> Iterator[CellView]:
    """Yield each cell and network once, a network before its cells."""
    shown: set[str] = set()
    stack: list[tuple[Node, int]] = [(wiring.root, 0)]
    while stack:
        node, depth = stack.pop()
        if node.name in shown:
            continue
        shown.add(node.name)
        port = ports[node.name]
        age_s = None if port.eo_stamp_ns is None else (now_ns - port.eo_stamp_ns) * 1e-9
        is_network = isinstance(node, Network)
        words = "" if is_network and wiring.outputs[node.name] is None else effect_words(port.eo)
        yield CellView(node.name, is_network, depth, port.ab, bool(port.ib), words, age_s, port.fault)
        if isinstance(node, Network):
            stack += [(each, depth + 1) for each in reversed(node.cells)]


def _sectors(ports: Mapping[str, PortState]) -> SectorsView:
    way = ports["Way finder"].eo if "Way finder" in ports else None
    if not isinstance(way, WayFound):
        return SectorsView(8, (), looked=False, words="Nobody has looked for free ways yet.")
    command = way.command
    told = f"{free_words(command)[0].upper()}{free_words(command)[1:]}."
    return SectorsView(command.sectors, command.orientations, command.kind is not FreeKind.NULL, told)


def free_words(command: FreeCommand) -> str:
    """Return the free orientations in words, as runs of sectors, from the right to the left."""
    if command.kind is FreeKind.NULL:
        return "nobody has looked for free ways"
    if command.kind is FreeKind.STOP:
        return "no way is free"
    step = math.tau / command.sectors
    numbers = sorted({round(angle / step) % command.sectors for angle in command.orientations})
    if len(numbers) == command.sectors:
        return "all ways are free"
    runs = list[list[int]]()
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    if len(runs) > 1 and runs[0][0] == 0 and runs[-1][-1] == command.sectors - 1:
        runs[0] = runs.pop() + runs[0]
    told = [_run_words(run[0] * step, run[-1] * step) for run in runs]
    return f"free {' and '.join(told)}"


def _run_words(first: float, last: float) -> str:
    if between(first, last) < 1e-6:
        return direction_words(first)
    return f"from {direction_words(first)} to {direction_words(last)}"


def direction_words(angle: float) -> str:
    """Return a direction in base in words, such as "45 degrees left"."""
    turned = wrap_angle(angle)
    degrees = math.ceil(round(abs(math.degrees(turned)), 3) - 0.5)  # halves down, whatever the last digit
    if degrees == 0:
        return "straight ahead"
    if degrees == 180:
        return "straight back"
    return f"{degrees} degrees {'left' if turned > 0 else 'right'}"


def _aim_view(aim: PanTiltAngles, order: object) -> AimView:
    words = aim_words(aim)
    if isinstance(order, SensorCommand):
        words = f"{words} {_order_words(order)[0].upper()}{_order_words(order)[1:]}."
    return AimView(wrap_angle(aim.pan), aim.tilt, aim.settled, words)


def _order_words(order: SensorCommand) -> str:
    """Return the cell that the camera serves, and those that wait for it."""
    told = f"the {order.client} has it"
    if isinstance(order, CameraOrder) and order.waiting:
        told += f", the {' and the '.join(order.waiting)} {'waits' if len(order.waiting) == 1 else 'wait'}"
    return told


def aim_words(aim: PanTiltAngles) -> str:
    """Return where the camera looks as a sentence."""
    if not (math.isfinite(aim.pan) and math.isfinite(aim.tilt)):
        return "The camera's servos report no angles."
    tilt = round(math.degrees(aim.tilt))
    level = "level" if tilt == 0 else f"{abs(tilt)} degrees {'up' if tilt > 0 else 'down'}"
    return f"The camera {'looks' if aim.settled else 'turns past'} {direction_words(aim.pan)}, {level}."


def _doorway_view(door: Doorway, odom_from_base: Pose2, body: ChairBody) -> DoorwayView:
    at = odom_from_base.inverse() @ door.pose
    away, bearing = math.hypot(at.x, at.y), math.atan2(at.y, at.x)
    enough = door.wide_enough(body.width)
    margin = door.margin(body.width)
    if enough:
        room = f"wide enough for this chair with {100 * margin:.0f} cm to spare"
    elif door.state is DoorState.OPEN and door.clear == 0.0 and door.width - door.error - body.width >= SPARE:
        room = "not yet seen from near, so it may be too narrow"
    else:
        room = "not surely wide enough for this chair"
    leaf = ", with a leaf" if door.leaf is not None else ""
    words = (
        f"Doorway {door.number}, {away:.1f} m away, {direction_words(bearing)}: {door.state.value}{leaf}, "
        f"{door.width:.2f} m wide to {max(1.0, 100 * door.error):.0f} cm, {room}."
    )
    return DoorwayView(door.number, at.x, at.y, at.theta, door.width, door.clear, door.state.value, enough, words)


def effect_words(effect: Any) -> str:
    """Return a cell's effect in a few words."""
    if effect is None:
        return "nothing"
    for kind, words in _WORDS:
        if isinstance(effect, kind):
            return words(effect)
    if isinstance(effect, tuple | list):
        return f"{len(effect)} values"
    return re.sub(r"(?<!^)([A-Z])", r" \1", type(effect).__name__).lower()


def _class_words(effect: ObstacleClasses) -> str:
    counts = [(each, sum(found is each for found in effect.classes)) for each in reversed(Obstacle)]
    told = [f"{count} {each.name.lower()}" for each, count in counts if count and each is not Obstacle.FAR]
    return ", ".join(told) or "nothing near"


def _check_words(effect: DoorCheck) -> str:
    return effect.state.value if effect.door is None else f"{effect.state.value}, {effect.door.width:.2f} m wide"


def _gated_words(effect: GatedSignals) -> str:
    parts = (("select_signal", effect.to_select), ("merge_commands", effect.to_merge))
    told = [f"{command.kind.value} to {name}" for name, command in parts if command is not None]
    return ", ".join(told) or "nothing"


def _trouble_words(effect: SensorTroubles) -> str:
    return "; ".join(effect.sentences) or "all sensors are well"


_WORDS: Sequence[tuple[type, Callable[[Any], str]]] = (
    (bool, lambda effect: "yes" if effect else "no"),
    (float, lambda effect: f"{effect:.4g}"),
    (int, str),
    (str, str),
    (Signal, signal_words),
    (DoorCommand, lambda effect: move_words(effect.move, effect.orientation)),
    (WayFound, lambda effect: free_words(effect.command)),
    (FreeCommand, free_words),
    (GatedSignals, _gated_words),
    (ObstacleClasses, _class_words),
    (DoorCheck, _check_words),
    (DoorSeen, lambda effect: f"doorway {effect.number}, {effect.door.width:.2f} m wide"),
    (TrackedDoor, lambda effect: f"a door {math.hypot(*effect.door.middle):.1f} m away, {effect.age_s:.1f} s old"),
    (SensorTroubles, _trouble_words),
    (SensorCommand, lambda effect: f"to {direction_words(effect.pan)}: {_order_words(effect)}"),
    (Depth, lambda effect: f"{len(effect.metres)} points, the nearest {float(effect.metres.min()):.1f} m away"),
)
