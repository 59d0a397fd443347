"""A real chair in its fleet: the rider's goal becomes a wish, and chains that are granted become goals of the pilot.

The pilot stands until its first chain is there. Whenever the rider steers, the chair keeps no order and says so, and its spots
follow its pose. Stop, joystick and monitors know nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from waychair.calibration.chair_body import ChairBody
from waychair.control.authority import FREE, Authority
from waychair.control.drive.navigation import ACTIVE, Navigation, Stage
from waychair.errors import FleetError
from waychair.maps.drawn.zones import Zone
from waychair.maps.traffic.traffic_graph import RefugeKind
from waychair.planning.fleet.peers.peer import Fleet
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.fleet_member import FleetMember
from waychair.runtime.fleet.peer_post import FleetTransport
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.runtime.fleet.spots_of_pose import SpotsOfPose
from waychair.runtime.pages.chair_port import OthersView
from waychair.runtime.pilot import Pilot
from waychair.types import Goal, OccupancyGrid, Place, Pose2, Scan

AT_PLACE = 0.5
"""m; a goal so near to a place of the traffic graph is that place."""

TONE_NS = 5_000_000_000
"""A chair that goes before all others sounds its tone so often while it drives."""

WAITS = "the chair waits for its turn"
_NOWHERE = "the chair is on no way of its traffic graph: drive it to one of its places, then ask again"


Redraw = Callable[[tuple[Zone, ...], Callable[[], None]], None]
"""Draws these bars on the pilot's map, beside its own zones, and then calls; it takes a while."""


@dataclass(slots=True)
class _Drive:
    """The rider's present goal: its refuge, how many goals of the last chain are left, and whether the pilot has them.

    `course`: the goals of the last chain. `toned_ns`: when the tone of a chair that goes before all others was due last.
    """

    refuge: str
    left: int = 0
    has_chain: bool = False
    course: tuple[Goal, ...] = ()
    toned_ns: int | None = None

    def tone(self, now_ns: int) -> bool:
        """Return whether the tone of a chair that goes before all others is due again."""
        due = self.toned_ns is None or now_ns - self.toned_ns >= TONE_NS
        self.toned_ns = now_ns if due else self.toned_ns
        return due


class FleetPort:
    """A chair's part in its fleet beside its pilot, on one map."""

    def __init__(
        self,
        fleet: Fleet,
        number: int,
        boot: int,
        transport: FleetTransport,
        body: ChairBody,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        redraw: Redraw,
        log: AuditFile | None = None,
        memory: Path | None = None,
    ) -> None:
        """`grid` and `places`: the map's; `log`, `memory`: see `FleetMember`.

        Raises:
            FleetError: a place of the traffic graph is not on the map.
        """
        refuges = fleet.ways.graph.refuges
        missing = [each.name for each in refuges if each.kind is RefugeKind.PLACE and each.name not in places]
        if missing:
            raise FleetError(
                f"the map has no place '{missing[0]}', but the fleet's traffic graph has: make the graph of this map, with "
                "`waychair fleet check MAP --out`"
            )
        self.others = OthersView()
        """The other chairs, for the rider's page."""
        self._fleet, self._number, self._boot = fleet, number, boot
        self._transport, self._body, self._places = transport, body, dict(places)
        self._spots = SpotsOfPose(fleet.ways, body, places)
        self._sight = SpotSight(fleet.ways, grid, body)
        self._member: FleetMember | None = None
        self._drive: _Drive | None = None
        self._redraw, self._log, self._memory = redraw, log, memory
        self._barred: frozenset[str] = frozenset()

    def see(self, scan: Scan, map_from_base: Pose2) -> None:
        """Take a scan, without the beams that hit the chair itself, and the chair's pose at its time."""
        self._sight.look(scan, map_from_base)

    def ask(self, goal: Pose2, now_ns: int) -> None:
        """Take a goal of the rider's, which the pilot has as well.

        Raises:
            FleetError: it is no place of the traffic graph, or the chair is on none of its ways.
        """
        if self._member is None:
            raise FleetError(_NOWHERE)
        near = [
            (math.dist((goal.x, goal.y), (place.pose.x, place.pose.y)), name)
            for name, place in self._places.items()
            if name in self._fleet.ways.slots
        ]
        if not near or min(near)[0] > AT_PLACE:
            some = ", ".join(sorted(self._fleet.ways.slots)[:5])
            raise FleetError(f"chairs that share this building drive to its places only: choose one, such as {some}")
        self._drive = _Drive(min(near)[1])
        self._member.want(self._drive.refuge, now_ns)
        self._member.driver.driver.start_anew()

    def answer(self, now_ns: int) -> None:
        """See `FleetMember.answer`."""
        if self._member is not None:
            self._member.answer(now_ns)

    @property
    def has_news(self) -> bool:
        """See `FleetMember.has_news`."""
        return self._member is not None and self._member.has_news

    def park(self) -> None:
        """See `FleetMember.park`."""
        if self._member is not None:
            self._member.park()

    def step(
        self,
        now_ns: int,
        pose: Pose2 | None,
        pilot: Pilot,
        by_rider: bool,
        navigation: Navigation | None = None,
        *,
        stands: bool = False,
    ) -> tuple[str, ...]:
        """Run a step of the peer, ten times a second, and give the pilot its authority and goals; return sentences for people.

        `pose`: `map_from_base`, None while unknown. `by_rider`: the rider steers. `navigation` is the pilot's last one. `stands`:
        the chair does not move.
        """
        member = self._member
        if pose is None:
            pilot.navigator.granted.authority = Authority(None, WAITS, self._drive is not None)
            return ()
        spots = self._spots.at(pose, () if member is None else member.entered)
        if member is None:
            if not spots:
                return ()
            driver = ChainDriver(self._fleet.ways, self._number, self._body, self._places)
            member = FleetMember(
                self._fleet, self._number, self._boot, driver, spots, self._transport, self._log, self._memory
            )
            self._member = member
        if by_rider and spots and spots != member.entered:
            member.stand_in(spots)
        self._note_end(member, pilot, now_ns)
        kept = _kept(member.entered, spots) if stands and self._drive is None else member.entered
        gives_back = kept != member.entered
        if gives_back:
            member.stand_in(kept)
        step = member.step(now_ns, pose, self._left(pilot), by_rider or gives_back, self._sight, navigation)
        drive, others = self._drive, member.others(now_ns)
        tone = step.tone or (others.lit and drive is not None and not stands and drive.tone(now_ns))
        self.others = replace(others, tones=self.others.tones + tone)
        if drive is None:
            pilot.navigator.granted.authority = FREE
            return step.notices
        goals = step.driven.goals
        if not goals and not drive.course and member.driver.driver.arrived_at(drive.refuge):
            goals = (Goal(drive.refuge),)  # it is in its refuge, though not at its place
        if goals:
            self._take_chain(drive, goals, step.driven.bars, pilot)
        waits = not drive.has_chain
        pilot.navigator.granted.authority = (
            Authority(None, step.told or WAITS, stands=True) if waits else step.driven.authority
        )
        return step.notices

    def _take_chain(self, drive: _Drive, goals: tuple[Goal, ...], bars: tuple[Zone, ...], pilot: Pilot) -> None:
        """Close the ways round a new chain on the pilot's map by bars, then give the pilot its goals."""
        drive.course, drive.has_chain = goals, False

        def set_off() -> None:
            if self._drive is drive and drive.course is goals:
                drive.has_chain, drive.left = True, len(goals)
                pilot.go(*goals)

        self._bar(bars, set_off)

    def _bar(self, bars: tuple[Zone, ...], then: Callable[[], None] = lambda: None) -> None:
        names = frozenset(bar.name for bar in bars)
        if names == self._barred:
            then()
            return
        self._barred = names
        self._redraw(bars, then)

    def _left(self, pilot: Pilot) -> int:
        """Return the goals of the present chain that are not reached yet."""
        drive = self._drive
        if drive is None or not drive.has_chain:
            return 0
        if pilot.navigator.stage is Stage.ARRIVED:
            drive.left = 0
        return drive.left

    def _note_end(self, member: FleetMember, pilot: Pilot, now_ns: int) -> None:
        """Forget the wish once its drive has ended: at its place, or because the rider or a stop ended it."""
        drive, stage = self._drive, pilot.navigator.stage
        if drive is None or pilot.waits or stage in ACTIVE:
            return
        if stage is Stage.ARRIVED and drive.has_chain and not member.driver.driver.arrived_at(drive.refuge):
            return  # at a place where it waits for the rest of its way
        self._drive = None
        member.want(None, now_ns)
        self._bar(())


def _kept(entered: tuple[int, ...], spots: tuple[int, ...]) -> tuple[int, ...]:
    """Return what a chair that goes nowhere keeps of the spots that it has entered: those in which it is, and all between them.

    It may be in others than it has entered, by the error of its pose; then it keeps all.
    """
    if not spots or not set(spots) <= set(entered):
        return entered
    places = [entered.index(spot) for spot in spots]
    return entered[min(places) : max(places) + 1]
