"""Zones of a map with rules for driving: `zones.yaml` beside `map.yaml`.

    stairs: {keep_out: true, polygon: [[1.0, 2.0], [3.0, 2.0], [3.0, 4.0], [1.0, 4.0]]}
    ward: {slow: 0.3, polygon: [[5.0, 0.0], [9.0, 0.0], [9.0, 6.0]]}
    ramp: {one_way: 90deg, polygon: [[10.0, 0.0], [11.2, 0.0], [11.2, 3.0], [10.0, 3.0]]}

A polygon's corners are x, y [m] in map. No part of the chair enters a keep-out zone; in a slow zone it drives at most
that fast [m/s]; in a one-way zone it drives along that heading (radians, or degrees as here), sideways to it, but not
back against it.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import ZoneError
from waychair.files import path_exists, refuse_empty_file
from waychair.geometry import MAX_COORDINATE, transform_points, wrap_angle
from waychair.maps.drawn.anchors import Anchors, load_anchors, write_anchored
from waychair.maps.drawn.places import places_path
from waychair.pose_text import ImpossiblePose, NoPoseText, angle_from_text, checked_turn
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2
from waychair.yaml_files import compose_yaml, node_value, quoted

ZONES_YAML = "zones.yaml"
ZONES = "zones"
"""The kind of the zones' anchors in `anchors.yaml`."""
_SHAPE = "{keep_out: true | slow: SPEED | one_way: HEADING, polygon: [[x, y], [x, y], [x, y], ...]}"
SLOWEST = 0.05
"""Least speed [m/s] of a slow zone; for less, draw a keep-out zone."""

_FASTEST = 1000.0
"""Largest speed [m/s] of a slow zone; beyond it the number is damaged."""


class Rule(enum.Enum):
    """The kind of a zone."""

    KEEP_OUT = "keep_out"
    SLOW = "slow"
    ONE_WAY = "one_way"


@dataclass(frozen=True, slots=True)
class Zone:
    """A named polygon (N, 2) [m] in map with its rule; `value` is the speed [m/s] or the heading [rad]."""

    name: str
    rule: Rule
    polygon: FloatArray
    value: float = 0.0


def load_zones(folder: Path) -> tuple[Zone, ...]:
    """Return the zones of a map, given its folder or YAML file; none without such a file.

    They are moved with the map's nodes (`maps.drawn.anchors`).

    Raises:
        MapError: the anchors are damaged.
        ZoneError: the file is broken; the message names the line and the zone.
    """
    path = places_path(folder).with_name(ZONES_YAML)
    if not path_exists(path, ZoneError):
        return ()
    refuse_empty_file(path, ZoneError, "{}")
    root = compose_yaml(path, ZoneError)
    if root is None:
        return ()
    if not isinstance(root, yaml.MappingNode):
        raise ZoneError(f"{path} must hold `name: {_SHAPE}` lines")
    zones: dict[str, Zone] = {}
    for key, value in root.value:
        zone = _zone(path, key, value)
        zones[zone.name] = zone
    anchors = load_anchors(path.parent)
    return tuple(_followed(zone, anchors) for zone in zones.values())


def check_zones(zones: Sequence[Zone], grid: OccupancyGrid) -> None:
    """Refuse zones off the map: people rely on the zones that they have drawn.

    Raises:
        ZoneError: a zone lies wholly outside the map.
    """
    for zone in zones:
        if not zone_cells(zone, grid)[1].any():
            x, y = zone.polygon.mean(axis=0).tolist()
            raise ZoneError(
                f"the zone '{zone.name}', round ({x:.1f}, {y:.1f}), lies wholly outside the map: correct its corners "
                f"in {ZONES_YAML}, or remove it"
            )


def save_zones(folder: Path, zones: Sequence[Zone]) -> None:
    """Write the zones of a map, whole or not at all.

    Raises:
        MapError: the anchors are damaged.
        OutputError: the folder cannot be made or written to.
    """
    points = {zone.name: zone_points(zone) for zone in zones}
    write_anchored(places_path(folder).with_name(ZONES_YAML), zones_text(zones), ZONES, points)


def zones_text(zones: Sequence[Zone]) -> str:
    """Return the text of `zones.yaml`."""
    values = {
        zone.name: {
            zone.rule.value: True if zone.rule is Rule.KEEP_OUT else float(zone.value),
            "polygon": zone.polygon.tolist(),
        }
        for zone in zones
    }
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None, allow_unicode=True, width=10_000)


def zone_points(zone: Zone) -> list[Pose2]:
    """Return the anchored points of a zone: its corners, with the zone's heading if it has one."""
    theta = zone.value if zone.rule is Rule.ONE_WAY else 0.0
    return [Pose2(x, y, theta) for x, y in zone.polygon.tolist()]


def checked_zone(zone: Zone) -> Zone:
    """Return the zone, if it can be written and read again.

    Raises:
        ZoneError: a name, a corner or a number is impossible.
    """
    if not zone.name or zone.name != zone.name.strip() or not zone.name.isprintable():
        raise ZoneError(f"{zone.name!r} cannot be the name of a zone; use letters, digits and single spaces")
    at = f"the zone '{zone.name}'"
    value: object = True if zone.rule is Rule.KEEP_OUT else float(zone.value)
    polygon = checked_polygon(at, zone.polygon.tolist())
    return Zone(zone.name, zone.rule, polygon, _value(at, zone.rule, {zone.rule.value: value}))


def _followed(zone: Zone, anchors: Anchors) -> Zone:
    points = zone_points(zone)
    now = anchors.follow(ZONES, zone.name, points)
    if now == points:
        return zone
    turned = sum(wrap_angle(b.theta - a.theta) for a, b in zip(points, now, strict=True)) / len(points)
    value = wrap_angle(zone.value + turned) if zone.rule is Rule.ONE_WAY else zone.value
    return replace(zone, polygon=np.array([[pose.x, pose.y] for pose in now]), value=value)


def zone_contains(zone: Zone, points: FloatArray) -> BoolArray:
    """Return (N,) whether points (N, 2) [m] in map lie in a zone: an odd number of its edges is to their right."""
    x, y = np.atleast_2d(points).T
    odd = np.zeros(len(x), np.bool_)
    for (x0, y0), (x1, y1) in zip(zone.polygon, np.roll(zone.polygon, -1, axis=0), strict=True):
        crosses = (y0 > y) != (y1 > y)
        odd ^= crosses & (x < x0 + (x1 - x0) * (y - y0) / np.where(crosses, y1 - y0, 1.0))
    return odd


def zone_cells(zone: Zone, grid: OccupancyGrid) -> tuple[tuple[slice, slice], BoolArray]:
    """Return the part of a grid round a zone, as rows and columns, and which of its cells overlap the zone.

    So a zone that is thinner than a cell, or lies between the centres of cells, still has cells.
    """
    corners = transform_points(grid.map_from_grid.inverse(), zone.polygon)[:, ::-1] / grid.resolution
    low = np.clip(np.floor(corners.min(axis=0)), 0, grid.cells.shape).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)), low, grid.cells.shape).astype(int)
    rows, columns = np.mgrid[low[0] : high[0], low[1] : high[1]]
    local = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=-1) * grid.resolution
    within = zone_contains(zone, transform_points(grid.map_from_grid, local)).reshape(rows.shape)
    for begin, end in zip(corners - low, np.roll(corners, -1, axis=0) - low, strict=True):
        _mark_crossed(within, begin, end)
    return (slice(low[0], high[0]), slice(low[1], high[1])), within


def _mark_crossed(cells: BoolArray, begin: FloatArray, end: FloatArray) -> None:
    """Set the cells (H, W) whose inside a straight line crosses; its ends (2,) are row and column [cells].

    A line along the border between two cells crosses neither.
    """
    least, most = np.minimum(begin, end) + _BORDER, np.maximum(begin, end) - _BORDER
    first = np.clip(np.floor(least), 0, cells.shape).astype(int)
    beyond = np.clip(np.floor(most) + 1, first, cells.shape).astype(int)
    rows, columns = np.mgrid[first[0] : beyond[0], first[1] : beyond[1]] + 0.5
    line = end - begin
    off = np.abs(line[0] * (columns - begin[1]) - line[1] * (rows - begin[0]))
    cells[first[0] : beyond[0], first[1] : beyond[1]] |= off < (0.5 - _BORDER) * np.abs(line).sum()


_BORDER = 1e-6
"""A point within this share of a cell of the cell's border counts as on the border."""


def keep_out_cells(zones: Sequence[Zone], grid: OccupancyGrid) -> BoolArray:
    """Return which cells (H, W) of a grid overlap a keep-out zone."""
    mask = np.zeros(grid.cells.shape, np.bool_)
    for zone in zones:
        if zone.rule is Rule.KEEP_OUT:
            part, within = zone_cells(zone, grid)
            mask[part] |= within
    return mask


def zone_speed_limit(zones: Sequence[Zone], points: FloatArray) -> float:
    """Return the lowest limit [m/s] of the slow zones that hold any of points (N, 2) [m] in map; inf outside all.

    The points cover the chair's footprint, now and where it will be once it has slowed down.
    """
    limits = [zone.value for zone in zones if zone.rule is Rule.SLOW and zone_contains(zone, points).any()]
    return min(limits, default=math.inf)


def _zone(path: Path, key: yaml.Node, value: yaml.Node) -> Zone:
    """Return a zone from its YAML nodes."""
    where = f"{path} line {key.start_mark.line + 1}"
    if not isinstance(key, yaml.ScalarNode) or not key.value.strip():
        raise ZoneError(f"{where}: a zone's name must be a word; write `name: {_SHAPE}`")
    at = f"{where}: '{key.value}'"
    fields = node_value(value, str(path), ZoneError)
    if not isinstance(fields, dict):
        raise ZoneError(f"{at} must be {_SHAPE}")
    rules = [rule for rule in Rule if rule.value in fields]
    unknown = [str(name) for name in fields if name != "polygon" and name not in {rule.value for rule in Rule}]
    if unknown or len(rules) != 1:
        found = f"not '{unknown[0]}'" if unknown else f"it has {len(rules)}"
        raise ZoneError(f"{at} must have one of keep_out, slow and one_way, {found}")
    return Zone(key.value, rules[0], checked_polygon(at, fields.get("polygon")), _value(at, rules[0], fields))


def _value(at: str, rule: Rule, fields: Mapping[str, object]) -> float:
    value = fields[rule.value]
    if rule is Rule.KEEP_OUT:
        if value is not True:
            raise ZoneError(f"{at}: keep_out is {quoted(value)}; write `keep_out: true`, or remove the zone")
        return 0.0
    if rule is Rule.ONE_WAY:
        return _heading(at, value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _FASTEST:
        raise ZoneError(f"{at}: slow is {quoted(value)}; it must be a number, and no more than {_FASTEST:g} m/s")
    if value < SLOWEST:
        raise ZoneError(f"{at}: slow is {value}; it must be at least {SLOWEST} m/s, or a keep-out zone")
    return float(value)


def _heading(at: str, value: object) -> float:
    """Return the heading [rad] of a one-way zone: a number of radians, or a text such as `90deg`."""
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise NoPoseText(f"{value} is not a number")
        return wrap_angle(checked_turn(float(value)) if isinstance(value, int | float) else angle_from_text(value))
    except ImpossiblePose as error:
        raise ZoneError(f"{at}: one_way is {quoted(value)}: {error}") from error
    except NoPoseText as error:
        raise ZoneError(
            f"{at}: one_way is {quoted(value)}; it must be a heading in radians, or in degrees such as 90deg"
        ) from error


def checked_polygon(at: str, corners: object) -> FloatArray:
    """Return the polygon (N, 2) [m] of a list of corners; `at` names the zone and its line in the error.

    Raises:
        ZoneError: it is no polygon, or has no area.
    """
    try:
        polygon = np.array(corners, np.float64)
    except (TypeError, ValueError, OverflowError):
        polygon = np.empty(0)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not (np.abs(polygon) <= MAX_COORDINATE).all():
        raise ZoneError(
            f"{at}: its polygon must be three or more corners [[x, y], ...], all of them numbers up to "
            f"{MAX_COORDINATE:g}"
        )
    x, y = (polygon - polygon[0]).T
    if abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) < 1e-9:
        raise ZoneError(f"{at}: its polygon has no area; give its corners in order round it")
    return polygon
