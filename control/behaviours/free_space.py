"""Free-space finding (paper 3.2): orientations without an immediate obstacle, from sonars, and the camera where needed.

A sector is blocked if a sonar in it hears something immediate, free if all its sonars are heard and none does, and
unknown else: no sonar looks into it, one is silent, or an echo was not borne out by a second one. Into an unknown sector
the Way finder asks to look by the camera's Range finder; what it saw counts for a while. An unknown sector is not free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.commands import NULL, STOP, FreeCommand, FreeKind, sector_middles, sector_of
from waychair.control.behaviours.paper_settings import CameraLimits, NavigationLimits, ObstacleLimits
from waychair.control.behaviours.range_finder import WAY_FINDER, Depth, LookRequest, SensorCommand
from waychair.control.behaviours.sonar import SonarRanges
from waychair.geometry import wrap_angle

SAME_ECHO = 0.15
"""m; greatest difference between two echoes of one thing, from noise and the chair's motion."""


_PARTS = 9
"""Parts of a sector, 5 degrees each, that a look must all have seen: a line is lost on black and on glass."""


@dataclass(frozen=True, slots=True)
class WayFinderConstants:
    """Constants of the Way finder: the sonars' directions [rad], the chair, and the limits."""

    sonars: tuple[float, ...]
    body: ChairBody
    obstacles: ObstacleLimits
    camera: CameraLimits
    navigation: NavigationLimits


@dataclass(frozen=True, slots=True)
class SectorLook:
    """A look into a sector by the camera: whether nothing immediate was seen, and the stamp."""

    sector: int
    free: bool
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class WayFinderMemory:
    """Dynamic data of the Way finder: the ranges before, the looks that still count, the sectors that failed, and the
    sector that it asked to look into."""

    ranges: tuple[float, ...] = ()
    looks: tuple[SectorLook, ...] = ()
    failed: tuple[SectorLook, ...] = ()
    asked: int | None = None


@dataclass(frozen=True, slots=True)
class WayFound:
    """The Way finder's output: Command_free, and the look it asks for."""

    command: FreeCommand
    request: LookRequest | None = None

    @property
    def asks(self) -> bool:
        """Whether it asks for a look."""
        return self.request is not None


NOT_LOOKED = WayFound(NULL)
"""The output of an inhibited Way finder."""


def find_way(
    ranges: SonarRanges | None,
    depth: Reading[Depth] | None,
    granted: SensorCommand | None,
    constants: WayFinderConstants,
    dynamic: WayFinderMemory,
    now_ns: int,
) -> tuple[WayFound, WayFinderMemory]:
    """Return the free orientations, and a request to look into the first unknown sector.

    Nothing known at all is "did not look". Sectors known and none free is "looked and found none".
    """
    metres = ranges.metres if ranges is not None else ()
    borne_out = tuple(_borne_out(each, dynamic.ranges, k) for k, each in enumerate(metres))
    keep_ns = round(constants.navigation.looked * 1e9)
    looks = _with_look(_young(dynamic.looks, now_ns, keep_ns), depth, granted, constants, now_ns)
    failed = _young(dynamic.failed, now_ns, keep_ns)
    if granted is not None and granted.client == WAY_FINDER and granted.fault:
        failed = (*failed, SectorLook(sector_of(granted.pan), False, now_ns))
    states = [_state(k, borne_out, looks, constants) for k in range(len(sector_middles()))]
    middles = sector_middles()
    free = tuple(middles[k] for k, state in enumerate(states) if state)
    unknown = [k for k, state in enumerate(states) if state is None]
    tried = {look.sector for look in failed}
    open_ones = [k for k in unknown if k not in tried]
    wanted = dynamic.asked if dynamic.asked in open_ones else next(iter(open_ones), None)  # or the servos never settle
    request = None if wanted is None else LookRequest(middles[wanted])
    none_free = NULL if len(unknown) == len(states) else STOP
    command = FreeCommand(FreeKind.LIST, free) if free else none_free
    return WayFound(command, request), WayFinderMemory(metres, looks, failed, wanted)


def _borne_out(metres: float, before: Sequence[float], k: int) -> float:
    """Return a range that the one before confirms, or that reports no echo or a thing too close; nan otherwise."""
    if not math.isfinite(metres):
        return metres
    confirmed = k < len(before) and abs(before[k] - metres) <= SAME_ECHO
    return metres if confirmed else math.nan


def _young(looks: Sequence[SectorLook], now_ns: int, keep_ns: int) -> tuple[SectorLook, ...]:
    return tuple(look for look in looks if 0 <= now_ns - look.stamp_ns <= keep_ns)


def _with_look(
    looks: tuple[SectorLook, ...],
    depth: Reading[Depth] | None,
    granted: SensorCommand | None,
    constants: WayFinderConstants,
    now_ns: int,
) -> tuple[SectorLook, ...]:
    """Return the looks with that of the present depth, if it was taken for the Way finder into a whole sector."""
    if depth is None or granted is None or granted.client != WAY_FINDER or not granted.settled:
        return looks
    if now_ns - depth.stamp_ns > round(constants.camera.fresh * 1e9):
        return looks
    sector = sector_of(granted.pan)
    half = math.pi / len(sector_middles())
    middle = sector_middles()[sector]
    limit = constants.obstacles.immediate + edge_distance(constants.body, middle)
    nearest = [math.inf] * _PARTS
    seen = [False] * _PARTS
    for bearing, metres in zip(depth.value.bearings.tolist(), depth.value.metres.tolist(), strict=True):
        part = math.floor((wrap_angle(bearing - middle) / half + 1.0) / 2.0 * _PARTS)
        if 0 <= part < _PARTS:
            seen[part], nearest[part] = True, min(nearest[part], metres)
    blocked = min(nearest) < limit
    if not blocked and not all(seen):
        return looks
    return (*(look for look in looks if look.sector != sector), SectorLook(sector, not blocked, now_ns))


def edge_distance(body: ChairBody, angle: float) -> float:
    """Return the distance [m] from the drive axle's middle to the chair's outline in a direction."""
    c, s = math.cos(angle), math.sin(angle)
    ahead = (body.front if c > 0.0 else body.rear) / abs(c) if abs(c) > 1e-9 else math.inf
    aside = body.width / 2 / abs(s) if abs(s) > 1e-9 else math.inf
    return min(ahead, aside)


def _state(
    sector: int, metres: Sequence[float], looks: Sequence[SectorLook], constants: WayFinderConstants
) -> bool | None:
    """Return whether a sector is free; None if it is unknown."""
    inside = [value for angle, value in zip(constants.sonars, metres, strict=False) if sector_of(angle) == sector]
    limit = constants.obstacles.immediate
    if any(value < limit for value in inside):
        return False
    if inside and not any(math.isnan(value) for value in inside):
        return True
    return next((look.free for look in looks if look.sector == sector), None)
