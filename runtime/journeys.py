"""A chair that travels over several storeys: `control/journey` on top of a `Chair`, with maps, lifts and the rider's words.

The owner calls `step` in place of the chair's. The rider's yes to a journey is the yes to each of its drives; a push of the
joystick, Stop, or whatever else ends a drive holds the journey until `go_on`, again by the rider.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.journey.door_view import Door, DoorView, beams_through, forgotten, is_shut_in, seen_door
from waychair.control.journey.journey import (
    IN_THE_CAR,
    SEEN_OPEN_S,
    DriveProgress,
    Journey,
    JourneyOrder,
    JourneyPhase,
    JourneyView,
    Leg,
    Standing,
    begun,
    cancel,
    go_on,
    step,
)
from waychair.control.journey.lift_site import LiftSite, stand_in
from waychair.control.journey.pressure_climb import PressureClimb
from waychair.control.journey.ride_motion import RideMotion
from waychair.control.journey.which_storey import StopEvidence, probabilities, seen_through_door
from waychair.control.safety.stops import Halt, halt
from waychair.control.safety.supervisor import deflection_of
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.travel_ports import LiftPort, TravellingChair
from waychair.slam.localising.localisation import LocalisationState
from waychair.slam.scan.scan_points import beam_ends
from waychair.types import DriveMode, ImuSample, OccupancyGrid, Place, Pose2, PressureSample, Scan

PRESS_AGAIN_S = 5.0
"""s; a button is pressed again after this time."""

BEGINS_WITHIN_S = 10.0
"""s; a drive of a journey that cannot begin for so long, for whatever reason, holds the journey."""

FREE_MARGIN = 0.25
"""m; a cabin is free if the chair can turn in it with this margin: a person's body reaches 0.2 m beyond the legs that the lidar
sees (`personal_space`), and the chair plans a turn with 5 cm."""

ABOARD_WITHIN = 0.6
"""m; a pose on the new map so far from that in the cabin is another place."""

_AT_REST = 0.02
"""m/s, rad/s; a chair that moves more slowly stands."""


@dataclass(frozen=True, slots=True)
class StoreyMap:
    """A storey's map: its grid, places and zones, the part that the lidar sees (None: all), and its height [m]."""

    storey: str
    grid: OccupancyGrid
    places: Mapping[str, Place]
    height: float = 0.0
    zones: Sequence[Zone] = ()
    scanned: OccupancyGrid | None = None


@dataclass(frozen=True, slots=True)
class TravelState:
    """A tick of a journey: the chair's state, the journey's, None without one, the order, and the storey of the map."""

    chair: ChairState
    journey: Journey | None
    order: JourneyOrder
    storey: str
    chances: Mapping[str, float]
    door: DoorView


@dataclass(slots=True)
class _Heard:
    """The latest messages, and the rider's words: the scan, the lift's door in it, whether Stop holds, why to hold, and the
    air's pressure.

    `shut_in`: the chair is in a lift whose door is not seen open, and no journey looks at it; `uncertain`: so is the storey since.
    `unready`: the drive that is wanted and cannot begin, by its key, and since when.
    """

    scan: Scan | None = None
    door: DoorView = field(default_factory=DoorView)
    stopped: bool = False
    hold: str = ""
    pressure: PressureClimb = field(default_factory=PressureClimb)
    shut_in: bool = False
    uncertain: bool = False
    unready: tuple[tuple[int, int] | None, int] = None, 0


@dataclass(slots=True)
class _Aboard:
    """What is known of a leg's ride: the chair in the cabin's frame by odometry, where it began, and the evidence."""

    leg: int = -1
    cabin_from_odom: Pose2 = field(default_factory=Pose2)
    began: str = ""
    match: dict[str, float] = field(default_factory=dict)
    rider: str | None = None
    beacon: str | None = None


class Traveller:
    """A chair with the maps of a building's storeys and the sites of its lifts."""

    def __init__(
        self,
        chair: TravellingChair,
        body: ChairBody,
        storeys: Sequence[StoreyMap],
        sites: Iterable[LiftSite],
        lifts: LiftPort,
        storey: str,
        worker: Executor | None = None,
        unmapped: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> None:
        """`storey`: that of the chair's map now. `worker` prepares maps beside the ticks; None: a tick waits for them.

        `unmapped`: of each lift the heights [m] of stops without a map or a known cabin, at which it may stop as well.
        """
        self._chair, self._body, self._lifts = chair, body, lifts
        self._maps = {each.storey: each for each in storeys}
        self._sites = {(site.lift, site.storey): site for site in sites}
        self._prepared: dict[str, Future[Any]] = {}
        self._worker, self._unmapped = worker, unmapped
        self.storey = storey
        self.journey: Journey | None = None
        self._motion = RideMotion()
        self._heard = _Heard()
        self._aboard = _Aboard()
        self._drive: tuple[tuple[int, int] | None, DriveProgress, str] = None, DriveProgress.NONE, ""
        self._pressed: tuple[str, str, int] = "", "", -(10**12)

    @property
    def under_way(self) -> bool:
        """Whether a journey goes on by itself: it has neither ended nor is it held."""
        return self.journey is not None and not self.journey.ended and self.journey.phase is not JourneyPhase.HELD

    @property
    def aboard(self) -> bool:
        """Whether the chair is in a lift, so that its storey is uncertain."""
        return self.journey is not None and self._is_aboard(self.journey)

    @property
    def shut_in(self) -> bool:
        """Whether the chair, without a journey, is in a lift whose door is not seen open: no word about its storey holds."""
        return self.journey is None and self._heard.shut_in

    def go(self, legs: Sequence[Leg], now_ns: int) -> None:
        """Begin a journey by the rider's yes; a goal for which the chair waits is that of the first leg."""
        self.journey = begun(tuple(legs), now_ns)
        self._drive, self._aboard = (None, DriveProgress.NONE, ""), _Aboard()
        self._heard.hold = ""
        if self._chair.waits:
            self._chair.confirm()
            self._drive = (self.journey.leg, self.journey.drives), DriveProgress.UNDER_WAY, ""

    def drop(self) -> None:
        """Forget a journey that could not begin, has ended, or gives way to another goal; its lift is let go."""
        if self.journey is not None and self.journey.here.lift:
            self._lifts.hold(self.journey.here.lift, held=False)
        self.journey = None

    def cancel(self, now_ns: int) -> None:
        """Cancel the journey; in a car the storey is still found out."""
        if self.journey is not None:
            self.journey = cancel(self.journey, now_ns)
            self._chair.cancel()

    def stop(self) -> None:
        """Obey the rider's Stop, which holds a journey in all its states."""
        self._chair.stop()
        self._heard.hold = "Stop was pressed"

    def pause(self) -> bool:
        """Hold the journey until `go_on`; on the way, the chair stands where it is. Return whether there is one to hold."""
        journey = self.journey
        if journey is None or not self.under_way:
            return self._chair.pause()
        if journey.phase is not JourneyPhase.DRIVE or not self._chair.pause():
            self._heard.hold = "paused"
        return True

    def go_on(self, now_ns: int) -> bool:
        """Continue a journey that was held, or a drive that was paused; return whether there is one."""
        if self.journey is not None and self.journey.phase is JourneyPhase.HELD:
            self.journey = go_on(self.journey, now_ns)
            return True
        return self._chair.go_on()

    def answer(self, storey: str, now_ns: int) -> None:
        """Take the rider's word for the storey; a journey that was held for it goes on."""
        self._aboard.rider = storey
        if (
            self.journey is not None
            and self.journey.phase is JourneyPhase.HELD
            and self.journey.resume is JourneyPhase.WHICH
        ):
            self.journey = go_on(self.journey, now_ns)

    def met_beacon(self, storey: str) -> None:
        """Take the word of a beacon, met in a lift at rest, for the storey."""
        if self.journey is not None and self.journey.phase is JourneyPhase.WHICH:
            self._aboard.beacon = storey

    def take_storey(self, storey: str, map_from_base: Pose2 | None) -> bool:
        """Change to another storey's map by the rider's word, without a journey; return False until it is made ready."""
        self.prepare(storey)
        if not self._prepared[storey].done():
            return False
        self._chair.change_storey(storey, self._prepared.pop(storey).result(), map_from_base)
        self.storey, self._heard.uncertain = storey, False
        return True

    def start_at(self, storey: str, map_from_base: Pose2) -> bool:
        """Localise anew where the rider says, on whichever storey; return False until its map is made ready."""
        if storey != self.storey:
            return self.take_storey(storey, map_from_base)
        self._chair.relocalise(map_from_base)
        self._doubt(certain=True)
        return True

    def prepare(self, storey: str) -> None:
        """Make a storey's map ready: by the worker, else at once, which takes a while."""
        if storey in self._prepared:
            return
        known = self._maps[storey]
        arguments = known.grid, known.places, known.zones, known.scanned
        if self._worker is not None:
            self._prepared[storey] = self._worker.submit(self._chair.prepared_storey, *arguments)
            return
        done: Future[Any] = Future()
        done.set_result(self._chair.prepared_storey(*arguments))
        self._prepared[storey] = done

    def replace_map(self, known: StoreyMap) -> None:
        """Take what somebody has drawn on a storey's map; the chair's present map is its owner's affair."""
        self._maps[known.storey] = known
        self._prepared.pop(known.storey, None)

    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt] = ()) -> TravelState:
        """Run one tick of the chair, and of its journey if there is one."""
        heard = tuple(messages)
        if self._heard.uncertain and not self.aboard:
            other_halts = (*other_halts, halt("floor_uncertain"))
        state = self._chair.step(now_ns, heard, other_halts)
        for message in heard:
            if isinstance(message, ImuSample):
                self._motion.hear(message)
            elif isinstance(message, PressureSample):
                self._heard.pressure.hear(message)
            elif isinstance(message, Scan):
                self._heard.scan = message
        self._note_drive(state)
        scanned = any(isinstance(message, Scan) for message in heard)
        if scanned and not self._looks_after_cabin(state):
            self._watch_cabin(state)
        if self.journey is None:
            return TravelState(state, None, JourneyOrder(""), self.storey, {}, self._heard.door)
        site = self._site(self.journey)
        if site is not None and scanned:
            self._look(site, state)
            if self.aboard and self._heard.door.open_s(state.stamp_ns) >= SEEN_OPEN_S:
                self._motion.stands()
        view, before = self._view(self.journey, site, state), self.journey
        self.journey, order = step(before, view)
        rides = self.journey.going is JourneyPhase.RIDE
        if rides and not self._heard.uncertain:
            self._doubt(certain=False)
        if rides and self._aboard.leg != self.journey.leg and site is not None:
            self._board(self.journey.leg, site, state)
        elif self.journey.phase is JourneyPhase.DRIVE and self._aboard.leg >= 0:
            self._aboard = _Aboard()  # the ride is over
        self._obey(self.journey, order, state)
        return TravelState(state, self.journey, order, self.storey, view.chances, self._heard.door)

    def _looks_after_cabin(self, state: ChairState) -> bool:
        """Return whether the journey knows of the lift in which the chair is: it rides in it, or drives in or out of it."""
        journey = self.journey
        if journey is None:
            return False
        site = self._site(journey)
        in_cabin = site is not None and site.holds(self._cabin_from_base(journey, site, state))
        return in_cabin or self._is_aboard(journey)

    def _watch_cabin(self, state: ChairState) -> None:
        """Doubt the storey of a chair that no journey looks after once the door of the lift in which it is is not seen open."""
        assert self._heard.scan is not None
        sites, base_from_laser = self._sites.values(), self._body.base_from_laser
        self._heard.shut_in = is_shut_in(self._heard.scan, sites, self.storey, state.map_from_base, base_from_laser)
        if self._heard.shut_in and not self._heard.uncertain:
            self._doubt(certain=False)

    def _doubt(self, *, certain: bool) -> None:
        self._heard.uncertain = not certain
        self._chair.doubt_storey(certain=certain)

    def _site(self, journey: Journey) -> LiftSite | None:
        """Return the lift that the journey is about, on the map in use."""
        return self._sites.get((journey.legs[journey.lift_leg].lift, self.storey))

    def _is_aboard(self, journey: Journey) -> bool:
        return journey.going in IN_THE_CAR and self._aboard.leg == journey.leg

    def _cabin_from_base(self, journey: Journey, site: LiftSite, state: ChairState) -> Pose2:
        if self._is_aboard(journey):  # the map may be the wrong one
            return self._aboard.cabin_from_odom @ self._chair.odom_from_base
        return site.cabin.inverse() @ state.map_from_base

    def _board(self, leg: int, site: LiftSite, state: ChairState) -> None:
        """Note that a ride may begin from here."""
        cabin_from_base = site.cabin.inverse() @ state.map_from_base
        self._aboard = _Aboard(leg, cabin_from_base @ self._chair.odom_from_base.inverse(), self.storey)
        self._motion.begin()
        self._heard.pressure.begin(state.stamp_ns)

    def _look(self, site: LiftSite, state: ChairState) -> None:
        """See the lift's door, and what is behind it, in the latest scan."""
        journey, scan = self.journey, self._heard.scan
        assert journey is not None
        assert scan is not None
        cabin_from_laser = self._cabin_from_base(journey, site, state) @ self._body.base_from_laser
        near = abs(cabin_from_laser.x) < 8.0 and abs(cabin_from_laser.y) < 8.0
        self._heard.door = (
            seen_door(self._heard.door, scan, cabin_from_laser, site) if near else forgotten(self._heard.door)
        )
        if journey.phase is JourneyPhase.WHICH and self._heard.door.door is Door.OPEN:
            angles, ranges = beams_through(scan, cabin_from_laser, site)
            self._aboard.match = {
                stop: seen_through_door(
                    self._maps[stop].grid, self._sites[site.lift, stop].cabin @ cabin_from_laser, angles, ranges
                )
                for stop in self._stops(site.lift)
                if len(angles)
            }

    def _stops(self, lift: str) -> list[str]:
        """Return the stops of a lift that have a map."""
        return [storey for name, storey in self._sites if name == lift and storey in self._maps]

    def _chances(self, journey: Journey, site: LiftSite | None, now_ns: int) -> dict[str, float]:
        if site is None or not self._is_aboard(journey):
            return {}
        aboard = self._aboard
        return probabilities(
            StopEvidence(
                heights={stop: self._maps[stop].height for stop in self._stops(site.lift)}
                | dict(self._unmapped.get(site.lift, {})),
                began=aboard.began,
                asked=journey.next_storey,
                climb=self._motion.climb(),
                pressure=self._heard.pressure.climb(now_ns),
                match=aboard.match,
                told=self._lifts.said(site.lift) or aboard.beacon,
                rider=aboard.rider,
            )
        )

    def _view(self, journey: Journey, site: LiftSite | None, state: ChairState) -> JourneyView:
        key, drive, why = self._drive
        drive = drive if key == (journey.leg, journey.drives) else DriveProgress.NONE
        stick = None if state.telemetry is None else state.telemetry.joystick
        pushed = stick is not None and not deflection_of(stick) < self._chair.settings.supervisor.override
        pushed = pushed or state.verdict.steered
        hold, was_stopped = self._heard.hold, self._heard.stopped
        self._heard.hold, self._heard.stopped = "", state.verdict.mode is DriveMode.STOPPED
        if self._heard.stopped and not was_stopped:  # it holds until the next drive; the rider may go on before
            hold = "Stop was pressed"
        hand = "you drive by the joystick" if pushed and not self._heard.stopped else hold
        twist = state.twist
        inside = None if site is None else self._cabin_from_base(journey, site, state)
        localised = state.localisation is not None and state.localisation.state is LocalisationState.OK
        if localised and site is not None and inside is not None and journey.phase is JourneyPhase.RELOCALISE:
            gap = site.cabin.inverse() @ state.map_from_base
            localised = not site.holds(inside) or float(np.hypot(gap.x - inside.x, gap.y - inside.y)) < ABOARD_WITHIN
        return JourneyView(
            now_ns=state.stamp_ns,
            storey=self.storey,
            drive=drive,
            why=hand or why,
            taken_over=bool(hand),
            at_rest=abs(twist.v) < _AT_REST and abs(twist.omega) < _AT_REST,
            in_cabin=site is not None and inside is not None and site.holds(inside),
            standing=Standing.CLEAR if site is None or inside is None else self._standing(site, inside),
            door=self._heard.door,
            cabin_free=None if site is None or inside is None else self._is_free(site, inside, state),
            riding=self._motion.riding,
            chances=self._chances(journey, site, state.stamp_ns),
            without_map=frozenset(self._unmapped.get("" if site is None else site.lift, ())),
            localised=localised,
            doubted=self._heard.uncertain and not self._is_aboard(journey),
        )

    def _standing(self, site: LiftSite, cabin_from_base: Pose2) -> Standing:
        """Return where the chair stands by its outline."""
        corners = transform_points(cabin_from_base, self._body.outline())
        beyond = corners[:, 0] > site.door_ahead + 0.05
        return Standing.CLEAR if beyond.all() else Standing.DOORWAY if beyond.any() else Standing.INSIDE

    def _is_free(self, site: LiftSite, cabin_from_base: Pose2, state: ChairState) -> bool | None:
        """Return whether the chair can turn in the cabin, as far as the lidar sees; None without a scan."""
        if self._heard.scan is None:
            return None
        ends, valid = beam_ends(self._heard.scan, self._body.base_from_laser, 8.0, state.twist)
        points = transform_points(cabin_from_base, ends[valid])
        stand = stand_in(site, self._body)
        inner = (np.abs(points[:, 0]) < site.length / 2 - 0.1) & (np.abs(points[:, 1]) < site.width / 2 - 0.1)
        near = np.hypot(points[:, 0] - stand.x, points[:, 1] - stand.y) < self._body.circumscribed_radius + FREE_MARGIN
        return not bool((inner & near).any())

    def _note_drive(self, state: ChairState) -> None:
        """Note how the drive under way is doing."""
        key, drive, _ = self._drive
        if drive is not DriveProgress.UNDER_WAY:
            return
        stage = state.navigation.stage.value
        if stage == "arrived":
            self._drive = key, DriveProgress.ARRIVED, ""
        elif not state.verdict.computer_drives:
            self._drive = key, DriveProgress.ENDED, state.verdict.reason
        elif stage == "failed":
            self._drive = key, DriveProgress.FAILED, state.navigation.reason

    def _obey(self, journey: Journey, order: JourneyOrder, state: ChairState) -> None:
        """Obey the journey's orders."""
        key, drive, _ = self._drive
        wanted = order.goal is not None
        if drive is DriveProgress.UNDER_WAY and (not wanted or order.key != key):
            self._chair.cancel()
            self._drive = None, DriveProgress.NONE, ""
        elif wanted and order.key != key and not self._chair.waits and self._is_ready(order.key, state):
            assert order.goal is not None
            waiting = tuple(site.waiting for (_, storey), site in self._sites.items() if storey == self.storey)
            self._chair.go(replace(order.goal, waiting=waiting))
            self._chair.confirm()
            self._drive = order.key, DriveProgress.UNDER_WAY, ""
        site = self._site(journey)
        if site is not None:
            self._lifts.hold(site.lift, order.hold)
            self._press(site.lift, order.call, state.stamp_ns)
        if order.switch is not None and order.switch != self.storey and site is not None:
            self._switch(site.lift, order.switch, journey, state)
        elif order.switch is not None and site is not None:  # the same storey again: only its place is uncertain
            self._chair.relocalise(self._site_pose(site, journey, state))
            self._doubt(certain=True)

    def _is_ready(self, key: tuple[int, int] | None, state: ChairState) -> bool:
        """Return whether a drive can begin; one that cannot for a while has ended before it began, which holds the journey."""
        before, since_ns = self._heard.unready
        since_ns = since_ns if before == key else state.stamp_ns
        if self._chair.ready:
            return True
        self._heard.unready = key, since_ns
        if (state.stamp_ns - since_ns) * 1e-9 > BEGINS_WITHIN_S:
            self._drive = key, DriveProgress.ENDED, state.verdict.reason or "the chair cannot drive now"
        return False

    def _press(self, lift: str, storey: str | None, now_ns: int) -> None:
        before = self._pressed
        if storey is None:
            self._pressed = "", "", -(10**12)
        elif before[:2] != (lift, storey) or now_ns - before[2] > PRESS_AGAIN_S * 1e9:
            self._lifts.call(lift, storey)
            self._pressed = lift, storey, now_ns

    def _site_pose(self, site: LiftSite, journey: Journey, state: ChairState) -> Pose2 | None:
        inside = self._cabin_from_base(journey, site, state)
        return site.cabin @ inside if journey.out or site.holds(inside) else None

    def _switch(self, lift: str, storey: str, journey: Journey, state: ChairState) -> None:
        """Change everything that belongs to the map, in this tick."""
        self.prepare(storey)
        if not self._prepared[storey].done():
            return  # the chair rests meanwhile
        site = self._sites[lift, storey]
        self._chair.change_storey(storey, self._prepared.pop(storey).result(), self._site_pose(site, journey, state))
        self.storey, self._heard.uncertain = storey, False
