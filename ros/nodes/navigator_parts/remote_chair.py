"""The chair as a journey sees it from the navigator's node: its drives, its pose, and the map that the mapper holds.

A drive is begun here and driven by the bridge, which must hear the rider's yes first. A journey has one yes for all its drives:
the bridge is asked to confirm each later one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from waychair.control.drive.navigator import Navigation, Stage
from waychair.control.safety.stops import Halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.errors import WaychairError
from waychair.maps.drawn.zones import Zone
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import DriveReport
from waychair.ros.messages.floor import Floor
from waychair.ros.messages.motion import pose, pose_with_covariance
from waychair.ros.messages.wire import native
from waychair.ros.nodes.node import ChairNode
from waychair.runtime.chair import ChairSettings, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.slam.localising.localisation import Localisation
from waychair.types import DriveMode, Goal, OccupancyGrid, Place, Pose2, SentCommand, Twist, WheelSpeeds

CONFIRMS_WITHIN_S = 5.0
"""s; a bridge that has not begun a confirmed drive by then does not begin it."""

AGAIN_S = 1.0
"""s; a request that was not answered is repeated after this time."""

SILENT_S = 0.4
"""s; a bridge whose last report is older does not drive: so a drive ends by its fault before the navigator gives it up (0.5 s), and
the rider lets the journey go on.
"""

PAGE_S = 1.0
"""s; a page that was heard so lately is open: the drive ends when no page with a Stop button is left."""

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ChairNow:
    """The navigator node's present knowledge: poses, twist, the drive and its goal, the bridge's report, floor and map.

    `continued`: by odometry, over silences and restarts. `floor`: the one told last; `revision`: of the map that the node has.
    """

    stamp_ns: int
    map_from_base: Pose2 | None
    odom_from_base: Pose2 | None
    continued: Pose2
    twist: Twist
    localisation: Localisation | None
    navigation: Navigation
    goal_id: int
    state: DriveReport | None
    floor: Floor | None
    revision: int


class LegDriver(Protocol):
    """The navigator's node."""

    def now(self) -> ChairNow:
        """Return its view of the chair."""

    def begin_leg(self, goal: Goal, goal_id: int) -> None:
        """Start a drive to a goal, which waits for a confirmation. Raises `WaychairError` if it cannot start."""

    def cancel_leg(self) -> None:
        """Come to rest and drop the goal."""

    def pause_leg(self) -> bool:
        """Come to rest and keep the goal; return whether there is a drive."""

    def go_on_leg(self) -> bool:
        """Continue the paused drive; return whether there is one."""


class RemoteChair:
    """A `TravellingChair` of several processes; `folders` are the map folders of the building's storeys."""

    def __init__(self, node: ChairNode[Any], driver: LegDriver, folders: Mapping[str, str]) -> None:
        self.settings = ChairSettings()
        self._node, self._driver, self._folders = node, driver, folders
        self._floor_service = node.create_client(interface_type("waychair_msgs/srv/SetFloor"), "set_floor")
        self._confirm_service = node.create_client(interface_type("waychair_msgs/srv/Confirm"), "confirm")
        self._send_pose = node.publisher(topics.INITIAL_POSE)
        self._goal_id = 0
        self._failed = ""
        self._confirm_ns: int | None = None
        """Since when the bridge has been asked to confirm the drive; None: it has begun, or waits for the rider."""
        self._asked_ns = self._page_ns = -(10**12)
        self._wanted: Any = None
        """The request to the mapper until the floor is as it asks."""
        self._pose = Pose2()
        """The chair in map as it was known last."""

    @property
    def goal_id(self) -> int:
        """The id of the drive that was asked for last."""
        return self._goal_id

    @property
    def failed(self) -> str:
        """Why the drive could not be begun; "" if it could."""
        return self._failed

    @property
    def changes_floor(self) -> bool:
        """Whether the floor is not yet as this chair has asked for."""
        return self._wanted is not None

    @property
    def stamp_ns(self) -> int:
        """The chair's time."""
        return self._driver.now().stamp_ns

    @property
    def ready(self) -> bool:
        """Whether a confirmed drive could begin now."""
        state = self._driver.now().state
        return state is not None and state.ready and self._confirm_ns is None

    @property
    def waits(self) -> bool:
        """Whether a drive that the rider has confirmed is under way already, so that a journey may begin by it."""
        state = self._driver.now().state
        return state is not None and state.goal_id == self._goal_id and state.driving and not state.steered

    @property
    def odom_from_base(self) -> Pose2:
        """The chair's pose by wheels and gyro alone."""
        return self._driver.now().continued

    def seen_page(self) -> None:
        """Note that a page with a Stop button is open."""
        self._page_ns = self._driver.now().stamp_ns

    def go(self, goal: Goal, *further: Goal) -> None:
        """Ask for a drive, which waits for a confirmation; a failure shows in the next tick."""
        self._goal_id, self._failed = self._driver.now().stamp_ns, ""
        try:
            self._driver.begin_leg(goal, self._goal_id)
        except WaychairError as error:
            self._failed = str(error)

    def confirm(self) -> None:
        """Have the bridge confirm the drive by the rider's yes to the journey."""
        if not self.waits:
            self._confirm_ns = self._driver.now().stamp_ns

    def cancel(self) -> None:
        """Come to rest and drop the goal."""
        self._confirm_ns = None
        self._driver.cancel_leg()

    def stop(self) -> None:
        """Drop the goal; the rider's Stop goes to the bridge."""
        self.cancel()

    def pause(self) -> bool:
        """Come to rest and keep the goal; return whether there is a drive."""
        return self._driver.pause_leg()

    def go_on(self) -> bool:
        """Continue the paused drive; return whether there is one."""
        return self._driver.go_on_leg()

    def relocalise(self, map_from_base: Pose2 | None) -> None:
        """Localise anew on the present map, near a pose."""
        if map_from_base is not None:
            self._send_pose(pose_with_covariance(self._driver.now().stamp_ns, map_from_base))

    def prepared_storey(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        zones: Sequence[Zone] = (),
        scanned: OccupancyGrid | None = None,
    ) -> Any:
        """Return None: every node prepares its own part."""
        return None

    def change_storey(self, storey: str, prepared: Any, map_from_base: Pose2 | None) -> None:
        """Have all nodes take another storey's map; the chair is localised once they have."""
        kind = interface_type("waychair_msgs/srv/SetFloor")
        request = kind.Request(map_url=self._folders[storey], certain=True, placed=map_from_base is not None)
        if map_from_base is not None:
            request.map_from_base = native(pose(map_from_base))
        self._pose = map_from_base or Pose2()
        self._want(request)

    def doubt_storey(self, *, certain: bool) -> None:
        """Tell all nodes whether the chair is certainly on the storey of its map; while it is not, no drive begins."""
        self._want(interface_type("waychair_msgs/srv/SetFloor").Request(certain=certain))

    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt] = ()) -> ChairState:
        """Return the chair's state now; ask for what is still to be done by other nodes."""
        now = self._driver.now()
        self._follow_floor(now)
        self._follow_confirmation(now)
        self._pose = now.map_from_base or self._pose
        state = now.state
        if state is None or now.stamp_ns - state.stamp_ns > SILENT_S * _NS:
            mode, reason = DriveMode.MANUAL, "the bridge does not answer"
        else:
            mode, reason = state.mode, state.reason or state.last_stop
        if self._confirm_ns is not None:
            mode, reason = DriveMode.AUTONOMOUS, ""  # the drive is about to begin
        steered = state is not None and (state.pushed or state.steered)
        navigation = (
            replace(now.navigation, stage=Stage.FAILED, reason=self._failed) if self._failed else now.navigation
        )
        return ChairState(
            stamp_ns=now.stamp_ns,
            map_from_base=self._pose,
            twist=now.twist,
            localisation=None if self._wanted is not None else now.localisation,
            verdict=SupervisorVerdict(mode, reason, steered=steered),
            halts=(),
            navigation=navigation,
            command=None if state is None else state.command,
            sent=SentCommand(now.stamp_ns, WheelSpeeds(), 0, 0, 0.0, 0.0, active=False, reason=""),
            telemetry=None,
        )

    def _want(self, request: Any) -> None:
        self._wanted, self._asked_ns = request, -(10**12)
        self._follow_floor(self._driver.now())

    def _follow_floor(self, now: ChairNow) -> None:
        """Ask the mapper until the floor is as wanted, and this node has its map."""
        request, told = self._wanted, now.floor
        if request is None:
            return
        same = told is not None and request.map_url in ("", told.map_folder) and told.certain == request.certain
        if same and told is not None and told.revision == now.revision:
            self._wanted = None
        elif not same and now.stamp_ns - self._asked_ns > AGAIN_S * _NS and self._floor_service.service_is_ready():
            self._asked_ns = now.stamp_ns
            self._floor_service.call_async(request)

    def _follow_confirmation(self, now: ChairNow) -> None:
        """Ask the bridge to confirm the drive until it has begun."""
        state = now.state
        if self._confirm_ns is None or state is None:
            return
        waited_s = (now.stamp_ns - self._confirm_ns) * 1e-9
        known = state.goal_id == self._goal_id
        if (known and (state.driving or state.drops_goal)) or waited_s > CONFIRMS_WITHIN_S:
            self._confirm_ns = None
        elif known and now.stamp_ns - self._asked_ns > AGAIN_S * _NS and self._confirm_service.service_is_ready():
            self._asked_ns = now.stamp_ns
            on_page = now.stamp_ns - self._page_ns < PAGE_S * _NS
            kind: Callable[..., Any] = interface_type("waychair_msgs/srv/Confirm").Request
            self._confirm_service.call_async(kind(goal_id=self._goal_id, on_page=on_page))

    def close(self) -> None:
        """Give the services up."""
        self._node.destroy_client(self._floor_service)
        self._node.destroy_client(self._confirm_service)
