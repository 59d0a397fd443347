"""The glove node's part that leads a rider: it hears where the chair is and how the stick is held, and runs a `HapticGuide`.

It drives nothing. The bridge holds the stick within the guide's cap by what `haptics/state` tells.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.next_door import DoorSide, next_door, no_door
from waychair.control.haptics.symbols import Advice
from waychair.control.safety.guard import BLIND_WITHIN, Unscanned
from waychair.errors import WaychairError
from waychair.maps.drawn.places import find, load_places
from waychair.maps.drawn.zones import load_zones
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.cells import read_perception
from waychair.ros.messages.chair import DriveReport, read_drive_state, read_localisation_on_floor
from waychair.ros.messages.floor import Floor, read_floor
from waychair.ros.messages.guard import read_guard
from waychair.ros.messages.json_text import json_text
from waychair.ros.messages.maps import read_loaded_grid
from waychair.ros.messages.motion import read_odometry
from waychair.ros.messages.sensors import read_scan
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.bridge_state import LastMessage
from waychair.ros.nodes.parts.map_layout import MapLayout
from waychair.runtime.haptics.haptic_guide import NO_ODOMETRY, HapticGuide
from waychair.runtime.haptics.haptic_state import HapticInputs, HapticState, RiderSurroundings
from waychair.runtime.haptics.session_log import SessionCounter
from waychair.runtime.haptics.teller import Teller
from waychair.runtime.pages.haptic_port import NOT_LED
from waychair.runtime.pages.perception_view import PerceptionView, shown_doorways, surroundings
from waychair.runtime.rider.guard_points import IN_ODOM, SENT_BEYOND, GuardPoints
from waychair.runtime.rider.guard_view import GuardView
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.topics import SCAN as SCAN_RATE
from waychair.types import HelpLevel, JoystickInput, OccupancyGrid, Odometry, Place, Pose2, Scan

NO_CELLS = "nobody looks for doorways: start the cells node with `perceive:=true`"

NO_MAP = "there is no map yet: wait until the chair's nodes have one"

_SILENT_NS = 1_000_000_000
"""ns; what another node told longer ago does not count any more."""

_NOWHERE = OccupancyGrid(np.full((1, 1), -1, np.int8), 0.05, Pose2())
"""The map before there is one: nothing is known."""


class _Heard:
    """The latest of each other node."""

    def __init__(self) -> None:
        self.located: tuple[int, Localisation, int] | None = None
        self.scan: Scan | None = None  # waits for its localisation
        self.guard, self.drive, self.cells = LastMessage(GuardView()), LastMessage(), LastMessage()


@dataclass(frozen=True, slots=True)
class _Goal:
    """Where the rider wants to be led: a place of the map, or one in odom."""

    place: Place
    on_map: bool


class LedRider:
    """Leads the rider of one chair; `guide` says what is due."""

    def __init__(
        self,
        node: ChairNode[Any],
        calibration: ChairCalibration,
        teller: Teller,
        learner: RiderLearner,
        scan_frame: str,
        session: SessionCounter,
    ) -> None:
        worker = ThreadPoolExecutor(1, "steps")
        node.at_end(worker.shutdown)
        self.guide = HapticGuide(
            calibration.body, teller, learner, _NOWHERE, worker=worker, around=self._around, session=session
        )
        self._node, self._calibration = node, calibration
        self._layout, self._track, self._heard = MapLayout({}, ()), OdometryTrack(), _Heard()
        self._goal: _Goal | None = None  # waits for the level at which the rider is led
        self._choose = node.create_client(interface_type("waychair_msgs/srv/ChooseLevel"), "choose_level")
        self._listen(scan_frame)
        self._send_walls = node.publisher(topics.SEEN_WALLS)
        node.create_service(interface_type("waychair_msgs/srv/Lead"), "haptics/lead", self._answer_lead)
        node.create_service(
            interface_type("waychair_msgs/srv/LeadThrough"), "haptics/lead_through", self._answer_lead_through
        )
        node.serve("haptics/end", self._end)
        node.serve("haptics/say_again", self._say_again)
        node.serve("haptics/say_where", self._say_where)

    def step(self, now_ns: int, others: Sequence[Advice] = ()) -> HapticState:
        """Run one tick; `others` is advice that other nodes have sent. Times are of the steady clock."""
        guard, pose = self._guard(now_ns), self._pose()
        forward, turn = guard.stick
        drive: DriveReport | None = self._fresh(self._heard.drive, now_ns)
        seen: PerceptionView | None = self._fresh(self._heard.cells, now_ns)
        if self._goal is not None and guard.level is not HelpLevel.GUARD:
            goal, self._goal = self._goal, None
            if goal.on_map:
                self.guide.lead(goal.place)
            else:
                self.guide.lead_by_odometry(goal.place)
        return self.guide.step(
            HapticInputs(
                now_ns=now_ns,
                pose=pose,
                twist=self._track.twist,
                level=guard.level,
                level_told=guard.told,
                stick=JoystickInput(now_ns, forward, turn),
                guard=guard.report,
                own_caps=guard.own_caps,
                signal=None if seen is None else seen.told,
                others=tuple(others),
                computer_drives=drive is not None and drive.driving and not drive.steered,
                odom_from_base=self._track.odom_from_base(self._node.now_ns()),
            )
        )

    def tell_walls(self) -> None:
        """Tell the guard of the walls that were seen on a way without a map, as they may be behind the chair by now."""
        now_ns = self._node.now_ns()
        pose = self._track.odom_from_base(now_ns)
        if pose is None:
            return
        walls = self.guide.seen_walls(pose, BLIND_WITHIN + SENT_BEYOND)
        if walls is not None:
            self._send_walls(json_text(GuardPoints.near(now_ns, IN_ODOM, Unscanned(mapped=walls), pose)))

    def _listen(self, scan_frame: str) -> None:
        node, heard, with_true_stamp = self._node, self._heard, self._calibration.with_true_stamp
        node.listen(topics.MAP, read_loaded_grid, self._take_map, needed=False)
        node.listen(topics.FLOOR, read_floor, self._take_floor, needed=False)
        node.listen(topics.LAYOUT, lambda message: message, lambda message: self._reload(), needed=False)
        node.listen(
            topics.ODOMETRY,
            lambda message: with_true_stamp(read_odometry(message)),
            self._take_odometry,
            needed=False,
        )
        node.listen(topics.LOCALISATION, read_localisation_on_floor, self._take_localisation, needed=False)
        node.listen(
            topics.SCAN, lambda message: with_true_stamp(read_scan(message, scan_frame)), self._take_scan, needed=False
        )
        node.listen(topics.GUARD, read_guard, heard.guard.take, needed=False)
        node.listen(topics.DRIVE_STATE, read_drive_state, heard.drive.take, needed=False)
        node.listen(topics.PERCEPTION, read_perception, heard.cells.take, needed=False)
        node.listen(topics.STOP, lambda message: message, lambda message: self._stop(), needed=False)

    def _take_map(self, loaded: tuple[OccupancyGrid, int]) -> None:
        self._layout.next_grid, self._layout.loaded_ns = loaded
        self._follow()

    def _take_floor(self, told: Floor) -> None:
        self._layout.floor = told
        self._follow()

    def _follow(self) -> None:
        """Take a map with its places and zones, once map and floor have both come; nobody is led on from the last one."""
        layout, before = self._layout, self._layout.grid
        try:
            other = layout.follow()
        except WaychairError as error:
            self._node.get_logger().error(f"{error}; nobody is led on this map")
            return
        if layout.waits or layout.next_grid is None:
            return
        layout.grid, layout.next_grid = layout.next_grid, None
        if other and before is not None:
            self.guide.end("the chair is on another storey")
            self._heard.located = self._heard.scan = None
        self.guide.redraw(layout.grid, layout.zones)

    def _reload(self) -> None:
        """Take places and zones that somebody has drawn."""
        layout = self._layout
        if layout.folder is None or layout.grid is None:
            return
        try:
            layout.places, layout.zones = load_places(layout.folder), load_zones(layout.folder)
        except WaychairError as error:
            self._node.get_logger().error(f"{error}; places and zones stay unchanged")
            return
        self.guide.redraw(layout.grid, layout.zones)

    def _take_odometry(self, odometry: Odometry) -> None:
        if self._track.take(odometry):
            if self._goal is not None and not self._goal.on_map:
                self._goal = None
            self._heard.located = None  # the odometry restarted, so the old localisation is void

    def _take_scan(self, scan: Scan) -> None:
        self._heard.scan = scan
        self._see()

    def _take_localisation(self, told: tuple[int, Localisation, int]) -> None:
        if told[2] == self._layout.revision:
            self._heard.located = told
            self._see()

    def _see(self) -> None:
        """Pass a scan on once its localisation has come; where nobody localises, at once."""
        scan, located = self._heard.scan, self._heard.located
        if scan is None:
            return
        located = None if located is None or SCAN_RATE.is_stale(located[0], scan.stamp_ns) else located
        odom_from_base = self._track.odom_from_base(scan.stamp_ns)
        if odom_from_base is None or (located is not None and located[0] != scan.stamp_ns):
            return
        self._heard.scan = None
        is_known = located is not None and located[1].state is not LocalisationState.LOST
        map_from_base = located[1].map_from_base if located is not None and is_known else None
        self.guide.see(self._calibration.masked(scan), map_from_base, odom_from_base, self._track.twist)

    def _pose(self) -> Pose2 | None:
        """Return the chair's pose now; None while it is lost, or nobody tells."""
        now_ns, located = self._node.now_ns(), self._heard.located
        odom_from_base = self._track.odom_from_base(now_ns)
        if located is None or odom_from_base is None or SCAN_RATE.is_stale(located[0], now_ns):
            return None
        return None if located[1].state is LocalisationState.LOST else located[1].map_from_odom @ odom_from_base

    def _guard(self, now_ns: int) -> GuardView:
        view: GuardView | None = self._fresh(self._heard.guard, now_ns)
        return GuardView() if view is None else view

    def _fresh(self, last: LastMessage, now_ns: int) -> Any:
        """Return the last word; None if that is long ago."""
        return last.value if now_ns - last.at_ns <= _SILENT_NS else None

    def _around(self) -> RiderSurroundings:
        return surroundings(self._layout.places, self._fresh(self._heard.cells, time.monotonic_ns()))

    def _stop(self) -> None:
        self._goal = None
        self.guide.end("Stop was pressed")

    def _answer_lead(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._lead(str(request.place))
        return response

    def _lead(self, name: str) -> tuple[bool, str]:
        """Lead the rider to a place of the map."""
        if self._layout.grid is None:
            return False, NO_MAP
        try:
            place = find(self._layout.places, name)
        except WaychairError as error:
            return False, str(error)
        self._begin(_Goal(place, on_map=True))
        return True, f"You are led to {name}."

    def _answer_lead_through(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._lead_through(str(request.side))
        return response

    def _lead_through(self, name: str) -> tuple[bool, str]:
        """Lead the rider through the next doorway that the cells have found on a side."""
        if name not in [side.value for side in DoorSide]:
            return False, f"there is no side '{name}': take left, ahead or right"
        side, seen = DoorSide(name), self._fresh(self._heard.cells, time.monotonic_ns())
        if seen is None:
            return False, NO_CELLS
        then, now = self._track.odom_from_base(seen.stamp_ns), self._track.odom_from_base(self._node.now_ns())
        if then is None or now is None:
            return False, NO_ODOMETRY
        place = next_door(shown_doorways(seen, then), now, side, self._calibration.body)
        if place is None:
            return False, no_door(side)
        self._begin(_Goal(place, on_map=False))
        return True, f"You are led through {place.name}."

    def _begin(self, goal: _Goal) -> None:
        """Lead from the level of help on at which a rider is led; one who is guarded is guided from now on."""
        if self._guard(time.monotonic_ns()).level is HelpLevel.GUARD:
            kind = interface_type("waychair_msgs/srv/ChooseLevel")
            self._choose.call_async(kind.Request(level=HelpLevel.GUIDE.value))
        self._goal = goal

    def _end(self) -> tuple[bool, str]:
        if self.guide.leader.goal is None and self._goal is None:
            return False, NOT_LED
        self._goal = None
        self.guide.end()
        return True, "you are no longer led"

    def _say_again(self) -> tuple[bool, str]:
        self.guide.say_again()
        return True, ""

    def _say_where(self) -> tuple[bool, str]:
        self.guide.say_where()
        return True, ""
