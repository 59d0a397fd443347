"""The records of a building's text files as model objects, and back: `node`, `arc`, `door`, `beacon`, `storey`, ..."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable

from waychair.errors import BuildingError
from waychair.geometry import MAX_COORDINATE
from waychair.maps.building.costs import CostSettings
from waychair.maps.building.hgraph import (
    Arc,
    Beacon,
    Closure,
    GraphDoorway,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Origin,
    Stop,
    Storey,
    SubMap,
    SubmapFrame,
    Way,
)
from waychair.maps.building.records import Record, line_of, time_text
from waychair.types import Pose2

LONGEST_M = 100_000.0
"""Longest arc and dearest price [m] that a file may give."""

_WIDEST_M, _SLOWEST, _FASTEST, _LONGEST_S = 100.0, 0.01, 10.0, 1e6
_STORED = {str(kind): kind for kind in NodeKind if kind is not NodeKind.SUBMAP}
_WAY = frozenset(("length_m", "width_m", "speed_mps", "drive_s", "price_m", "oneway", "ramp", "closed", "until", "by"))
_KEYS = {
    "node": frozenset(("id", "kind", "x", "y", "name", "by")),
    "arc": _WAY | {"from", "to"},
    "door": _WAY | {"from", "to"},
    "beacon": frozenset(("id", "x", "y", "theta", "node")),
    "building": frozenset(("name",)),
    "cost": frozenset(entry.name for entry in dataclasses.fields(CostSettings)),
    "storey": frozenset(("id", "name", "height_m", "map")),
    "submap": frozenset(("path", "name", "storey", "x", "y", "theta", "scale")),
    "lift": frozenset(
        ("id", "name", "cabin_width_m", "cabin_depth_m", "door_width_m", "wait_m", "board_m", "storey_m")
    ),
    "stop": frozenset(("lift", "storey", "at", "door_width_m", "cabin_x", "cabin_y", "cabin_theta", "closed", "until")),
}
_WORD = re.compile(r"\w[\w.-]*")


def checked_id(record: Record, key: str) -> str:
    """Return an id: letters, digits, `_`, `-` and `.`, beginning with one of the first three.

    Raises:
        BuildingError: it is another text.
    """
    text = record.text(key)
    if not is_id(text):
        raise record.error(f"{key} is '{text}': use letters, digits, _, - and . only, and name= for other text")
    return text


def is_id(text: str) -> bool:
    """Return whether a text can be the id of a node, storey or lift, or a part of a sub-map's path."""
    return _WORD.fullmatch(text) is not None


def node_of(record: Record) -> Node:
    """Return a `node` record's node; raises BuildingError as all here."""
    record.allow(_KEYS["node"])
    kind = record.text("kind")
    if kind not in _STORED:
        raise record.error(f"kind is '{kind}': write {', '.join(_STORED)}")
    x, y = _coordinate(record, "x"), _coordinate(record, "y")
    return Node(checked_id(record, "id"), _STORED[kind], x, y, record.text("name", ""), _origin(record))


def node_line(node: Node) -> str:
    """Return a node's record."""
    name = node.name or None
    values = [("id", node.id), ("kind", node.kind), ("x", float(node.x)), ("y", float(node.y)), ("name", name)]
    return line_of("node", [*values, ("by", _by(node.origin))])


def arc_of(record: Record) -> Arc:
    """Return an `arc` record's arc."""
    record.allow(_KEYS["arc"])
    way = _way(record, one_way=record.flag("oneway"))
    return Arc(checked_id(record, "from"), checked_id(record, "to"), way, _origin(record))


def arc_line(arc: Arc) -> str:
    """Return an arc's record."""
    return line_of("arc", [("from", arc.start), ("to", arc.end), *_way_values(arc.way), ("by", _by(arc.origin))])


def doorway_of(record: Record) -> GraphDoorway:
    """Return a `door` record's doorway: `from=NODE to=CHILD:NODE`; a one-way one has `oneway=in` or `oneway=out`."""
    record.allow(_KEYS["door"])
    child, colon, node = record.text("to").partition(":")
    if not colon or not is_id(child) or not is_id(node):
        raise record.error(f"to is '{record.text('to')}': write CHILD:NODE, as in room-12:d1")
    direction = record.text("oneway", "no")
    if direction not in ("no", "in", "out"):
        raise record.error(f"oneway is '{direction}': write in, out or no")
    way = _way(record, one_way=direction != "no")
    return GraphDoorway(checked_id(record, "from"), child, node, way, direction == "out", _origin(record))


def doorway_line(doorway: GraphDoorway) -> str:
    """Return a doorway's record."""
    one_way = ("out" if doorway.outwards else "in") if doorway.way.one_way else None
    others = [(key, value) for key, value in _way_values(doorway.way) if key != "oneway"]
    values = [("from", doorway.start), ("to", f"{doorway.child}:{doorway.node}"), ("oneway", one_way), *others]
    return line_of("door", [*values, ("by", _by(doorway.origin))])


def beacon_of(record: Record) -> Beacon:
    """Return a `beacon` record's beacon."""
    record.allow(_KEYS["beacon"])
    pose = Pose2(_coordinate(record, "x"), _coordinate(record, "y"), _angle(record))
    return Beacon(checked_id(record, "id"), pose, record.text("node", ""))


def beacon_line(beacon: Beacon) -> str:
    """Return a beacon's record."""
    pose = [("x", float(beacon.pose.x)), ("y", float(beacon.pose.y)), ("theta", float(beacon.pose.theta) or None)]
    return line_of("beacon", [("id", beacon.id), *pose, ("node", beacon.node or None)])


def costs_of(record: Record) -> CostSettings:
    """Return a `cost` record's settings; those that are not named keep their defaults."""
    record.allow(_KEYS["cost"])
    values = {}
    for entry in dataclasses.fields(CostSettings):
        if entry.name in record.values:
            values[entry.name] = record.number_of(entry.name, entry.metadata["low"], entry.metadata["high"])
    return CostSettings(**values)


def costs_line(costs: CostSettings) -> str:
    """Return the record of all cost settings."""
    return line_of("cost", [(entry.name, float(getattr(costs, entry.name))) for entry in dataclasses.fields(costs)])


def storey_of(record: Record) -> Storey:
    """Return a `storey` record's storey."""
    record.allow(_KEYS["storey"])
    height = record.number_of("height_m", -1000.0, 10_000.0, 0.0)
    return Storey(checked_id(record, "id"), record.text("name", ""), height, record.text("map", ""))


def storey_line(storey: Storey) -> str:
    """Return a storey's record."""
    others = [("name", storey.name or None), ("height_m", float(storey.height)), ("map", storey.map or None)]
    return line_of("storey", [("id", storey.id), *others])


def submap_of(record: Record) -> SubMap:
    """Return a `submap` record's sub-map, without its nodes."""
    record.allow(_KEYS["submap"])
    path = record.text("path")
    if not all(map(is_id, path.split("/"))):
        raise record.error(f"path is '{path}': write its ancestors and itself, as in ground/west/room-12")
    x, y = record.number_of("x", -MAX_COORDINATE, MAX_COORDINATE, 0.0), 0.0
    y = record.number_of("y", -MAX_COORDINATE, MAX_COORDINATE, 0.0)
    frame = SubmapFrame(x, y, _angle(record), record.number_of("scale", 1e-6, 1e6, 1.0))
    return SubMap(path, record.text("name", ""), frame, record.text("storey", ""))


def submap_line(submap: SubMap) -> str:
    """Return a sub-map's record in the general file."""
    frame = submap.frame
    place = [("x", float(frame.x) or None), ("y", float(frame.y) or None), ("theta", float(frame.theta) or None)]
    scale = None if frame.scale == 1.0 else float(frame.scale)
    names = [("name", submap.name or None), ("storey", submap.storey or None)]
    return line_of("submap", [("path", submap.path), *names, *place, ("scale", scale)])


def lift_of(record: Record) -> Lift:
    """Return a `lift` record's lift, without its stops."""
    record.allow(_KEYS["lift"])
    sizes = [record.maybe(key, 0.0, _WIDEST_M) for key in ("cabin_width_m", "cabin_depth_m", "door_width_m")]
    costs = [record.maybe(key, 0.0, LONGEST_M) for key in ("wait_m", "board_m", "storey_m")]
    return Lift(checked_id(record, "id"), record.text("name", ""), (), *sizes, *costs)


def lift_line(lift: Lift) -> str:
    """Return a lift's record."""
    sizes = [
        ("cabin_width_m", lift.cabin_width),
        ("cabin_depth_m", lift.cabin_depth),
        ("door_width_m", lift.door_width),
    ]
    costs = [("wait_m", lift.wait), ("board_m", lift.board), ("storey_m", lift.per_storey)]
    return line_of("lift", [("id", lift.id), ("name", lift.name or None), *_floats([*sizes, *costs])])


def stop_of(record: Record) -> tuple[str, Stop]:
    """Return a `stop` record's lift and stop."""
    record.allow(_KEYS["stop"])
    width = record.maybe("door_width_m", 0.0, _WIDEST_M)
    stop = Stop(checked_id(record, "storey"), ref_of(record, "at"), width, _closure(record), _cabin(record))
    return checked_id(record, "lift"), stop


def stop_line(lift: str, stop: Stop) -> str:
    """Return the record of a lift's stop."""
    values = [("lift", lift), ("storey", stop.storey), ("at", stop.at), *_floats([("door_width_m", stop.door_width)])]
    cabin = stop.cabin
    place: list[tuple[str, float | None]] = (
        [] if cabin is None else [("cabin_x", cabin.x), ("cabin_y", cabin.y), ("cabin_theta", cabin.theta)]
    )
    return line_of("stop", [*values, *_floats(place), *_closure_values(stop.closure)])


def _cabin(record: Record) -> Pose2 | None:
    """Return the pose of a stop's cabin; None without one."""
    x, y = (record.maybe(key, -MAX_COORDINATE, MAX_COORDINATE) for key in ("cabin_x", "cabin_y"))
    theta = record.maybe("cabin_theta", -math.tau, math.tau)
    if x is None and y is None and theta is None:
        return None
    if x is None or y is None or theta is None:
        raise record.error("a cabin needs cabin_x, cabin_y and cabin_theta: give all three, or none")
    return Pose2(x, y, theta)


def ref_of(record: Record, key: str) -> NodeRef:
    """Return a node's address, `PATH:NODE`."""
    path, colon, node = record.text(key).rpartition(":")
    if not colon or not is_id(node):
        raise record.error(f"{key} is '{record.text(key)}': write PATH:NODE, as in ground/west:v1")
    return NodeRef(path, node)


def checked_line(line: str, what: Callable[[], str]) -> str:
    """Return a record's line; `what` names the thing in the error.

    Raises:
        BuildingError: a name in it cannot be written on one line.
    """
    if line.isprintable():
        return line
    raise BuildingError(f"the name of {what()} has a line break or control character: take it out")


def _way(record: Record, one_way: bool) -> Way:
    values = record.values
    if len(values) == 2:  # only its ends, as most arcs
        return _PLAIN
    return Way(
        record.maybe("length_m", 0.0, LONGEST_M),
        record.maybe("width_m", 0.0, _WIDEST_M),
        record.maybe("speed_mps", _SLOWEST, _FASTEST),
        record.maybe("drive_s", 0.0, _LONGEST_S),
        record.maybe("price_m", 0.0, LONGEST_M),
        one_way,
        record.flag("ramp"),
        _closure(record),
    )


_PLAIN = Way()


def _way_values(way: Way) -> list[tuple[str, object]]:
    if way == _PLAIN:
        return []
    measures = [("length_m", way.length), ("width_m", way.width), ("speed_mps", way.speed)]
    prices = [("drive_s", way.drive_s), ("price_m", way.price)]
    rules: list[tuple[str, object]] = [("oneway", way.one_way), ("ramp", way.ramp)]
    return [*_floats([*measures, *prices]), *rules, *_closure_values(way.closure)]


def _closure(record: Record) -> Closure | None:
    until = record.time_ns("until")
    if "closed" not in record.values:
        if until is not None:
            raise record.error("until is given without closed: give the reason, as in closed=cleaning")
        return None
    return Closure(record.text("closed"), until)


def _closure_values(closure: Closure | None) -> list[tuple[str, object]]:
    if closure is None:
        return []
    return [("closed", closure.reason or "closed"), ("until", time_text(closure.until_ns))]


def _floats(values: list[tuple[str, float | None]]) -> list[tuple[str, object]]:
    return [(key, None if value is None else float(value)) for key, value in values]


def _coordinate(record: Record, key: str) -> float:
    return record.number_of(key, -MAX_COORDINATE, MAX_COORDINATE)


def _angle(record: Record) -> float:
    return record.number_of("theta", -math.tau, math.tau, 0.0)


def _origin(record: Record) -> Origin:
    by = record.values.get("by")
    if by is None:
        return Origin.HAND
    if by not in ("auto", "hand"):
        raise record.error(f"by is '{by}': write auto or hand")
    return Origin(by)


def _by(origin: Origin) -> str | None:
    return str(origin) if origin is Origin.AUTO else None
