"""The pilot: goals that wait for the rider's yes, obstacles from the sensors, and the navigator.

Each tick it takes in the chair's pose and sensor messages and asks for a twist. The `DriveBase` decides whether the
chair drives; a drive that its verdict interrupts or refuses is dropped and never resumes by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.stopping import StopTable, permitted_speed
from waychair.config import setting
from waychair.control.drive.echo_filter import EchoFilter
from waychair.control.drive.navigator import Navigation, Navigator, NavigatorSettings, Stage
from waychair.control.safety.collision_monitor import MAPPED_WITHIN, points_now, slim_beams
from waychair.control.safety.guard import Unscanned
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.geometry import transform_points
from waychair.maps.depth.ground import GroundView
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import are_occupied, occupied_edges
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.window.motion_limits import measured
from waychair.runtime.base_settings import BaseSettings
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.odometry.tilt import Tilt
from waychair.slam.scan.scan_points import beam_ends
from waychair.types import FloatArray, Goal, OccupancyGrid, Place, Pose2, RgbdFrame, Scan, SonarReadings, Twist


@dataclass(frozen=True, slots=True)
class PilotSettings(BaseSettings):
    """The settings of the navigator, and of the drive base whose limits it plans within."""

    navigator: NavigatorSettings = field(default_factory=NavigatorSettings)
    max_pause_s: float = setting(
        300.0,
        "s",
        "time after which a paused drive is dropped; larger: it keeps its goal longer",
        low=1.0,
        high=86400.0,
    )


_NOTHING: FloatArray = np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class _ScanView:
    """Points of a scan, (N, 2) [m] in map, ends of its free beams, (M, 2), and its stamp; None without a scan."""

    points: FloatArray | None = None
    beyond: FloatArray | None = None
    seen_ns: int | None = None


class Pilot:
    """Takes goals and asks for the twists that lead to them."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        settings: PilotSettings | None = None,
        stops: StopTable | None = None,
        zones: Sequence[Zone] = (),
        tops: FloatArray | None = None,
    ) -> None:
        """stops: stopping distances measured on this chair; without them it crawls. `zones` are the map's.

        `tops` (N, 2) [m]: what the map shows and no lidar, such as the tops of tables (`unscanned_points`).
        """
        self.settings = settings or PilotSettings()
        self.body = body
        self.navigator = Navigator(grid, places, body, _within(self.settings, stops), zones)
        self._goals: tuple[Goal, ...] = ()  # waiting for the rider's yes
        self._goals_since_ns: int | None = None
        self._paused_since_ns: int | None = None
        self._sight = _ScanView()  # since the last tick
        self._echo_filter = EchoFilter()
        self._tops = _NOTHING if tops is None else tops
        self._mapped = occupied_edges(grid)
        self.mapped_legs = _NOTHING
        """Points of the latest scan that look like legs but are on the map, (N, 2) [m] in base; none if unlocalised."""

    def go(self, goal: Goal, *further: Goal) -> None:
        """Take a goal, or a list of them, which waits for the rider's yes.

        Raises:
            UnknownPlace: a goal's place is not on the map.
            GoalTooExact: a goal's tolerance is smaller than a chair can stop within.
        """
        self.navigator.go(goal, *further)
        self._goals, self._goals_since_ns = (goal, *further), None

    @property
    def waits(self) -> bool:
        """Whether a goal waits for the rider's yes."""
        return bool(self._goals)

    def pause(self) -> bool:
        """Bring a drive under way to rest until `go_on`; return whether there is one."""
        if self.waits or not self.navigator.active:
            return False
        self.navigator.pause()
        return True

    def go_on(self) -> bool:
        """Let a paused drive go on, or one that offers another way take it; return whether there is one."""
        goes_on = not self.waits and self.navigator.stage in (Stage.PAUSED, Stage.OFFERING)
        self.navigator.resume()
        return goes_on

    def drop(self, reason: str) -> None:
        """Drop the waiting goals and end the drive."""
        self._goals = ()
        self.navigator.cancel(reason)

    def drawn(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> DrawnMap:
        """Prepare a map for `redraw`; takes a while, and may be called from any thread."""
        return DrawnMap(grid, self.body, zones, self.navigator.settings.clearance.comfortable)

    def redraw(self, drawn: DrawnMap, places: Mapping[str, Place]) -> None:
        """Replace the map and the places; a drive under way is replanned, one that has ended stays ended."""
        self.navigator.redraw(drawn, places)
        self._tops = self._tops[are_occupied(drawn.grid, self._tops)]
        self._mapped = occupied_edges(drawn.grid)

    @property
    def unscanned(self) -> Unscanned:
        """Points in map for the guard: drop-offs, things that no lidar shows, and things that stand where no sensor looks.

        The last are the outline of the map, and what the lidar saw a moment ago.
        """
        drops, things, stood = self.navigator.beyond_scans
        return Unscanned(drops, np.concatenate([things, self._tops]), np.concatenate([self._mapped, stood]))

    def see(self, scan: Scan, localisation: Localisation, twist: Twist) -> None:
        """Take in a scan without the beams that hit the chair itself, and the pose at which it was taken."""
        reach, mount = self.settings.navigator.obstacle_range, self.body.base_from_laser
        reach = min(reach, scan.range_max) if scan.range_max > 0.0 else reach
        # a beam beyond the reach shows free space up to there
        clear = scan.ranges >= reach
        within = replace(scan, ranges=np.where(clear, np.float32(0.999 * reach), scan.ranges))
        ends, valid = beam_ends(within, mount, reach, twist)
        pose = localisation.map_from_base
        self.mapped_legs = (
            self._mapped_legs(scan, pose, twist) if localisation.state is LocalisationState.OK else _NOTHING
        )
        halfway_ns = round(scan.time_step * len(scan.ranges) / 2 * 1e9)
        self._sight = _ScanView(
            transform_points(pose, ends[valid & ~clear]),
            transform_points(pose, ends[valid & clear]),
            scan.stamp_ns + halfway_ns,
        )

    def _mapped_legs(self, scan: Scan, pose: Pose2, twist: Twist) -> FloatArray:
        slim = slim_beams(scan, np.zeros(len(scan.ranges), np.bool_))
        points = points_now(scan, slim, self.body, twist, scan.stamp_ns)
        mapped: FloatArray = points[self.navigator.is_mapped(transform_points(pose, points), MAPPED_WITHIN)]
        return mapped

    def hear(self, readings: SonarReadings, map_from_base: Pose2) -> None:
        """Take in sonar readings; an echo counts only once a second reading confirms it."""
        self.navigator.hear(self._echo_filter.confirmed(readings), map_from_base)

    def look(self, frame: RgbdFrame, map_from_base: Pose2, tilt: Tilt | None) -> GroundView:
        """Take in a picture of the depth camera, and the chair's tilt if it is known; return the ground in it."""
        return self.navigator.look(frame, map_from_base, None if tilt is None else tilt.level_from_base())

    def expire(self, now_ns: int) -> None:
        """Drop a goal that has waited too long for its yes, or a drive that was paused for too long."""
        if self.navigator.stage is not Stage.PAUSED:
            self._paused_since_ns = None
        elif self._paused_since_ns is None:
            self._paused_since_ns = now_ns
        elif now_ns - self._paused_since_ns > self.settings.max_pause_s * 1e9:
            self.drop("the drive was paused for too long: ask for the goal again")
        if not self._goals:
            return
        self._goals_since_ns = now_ns if self._goals_since_ns is None else self._goals_since_ns
        if now_ns - self._goals_since_ns > self.settings.supervisor.confirm_s * 1e9:
            self.drop("nobody has confirmed the drive: ask for the goal again")

    def obey(self, verdict: SupervisorVerdict) -> None:
        """Begin the confirmed goals, or drop a drive that was interrupted or refused."""
        if verdict.drops_goal or not self.navigator.active:
            self.drop(verdict.reason)
        elif verdict.computer_drives and self._goals:
            self.navigator.go(*self._goals)  # anew, so that attempts from before the yes do not count
            self._goals = ()

    def step(self, now_ns: int, map_from_base: Pose2, map_from_odom: Pose2 | None) -> Navigation:
        """Return the next twist to ask for."""
        sight, self._sight = self._sight, _ScanView()
        return self.navigator.step(
            now_ns=now_ns,
            pose=map_from_base,
            obstacles=sight.points,
            map_from_odom=map_from_odom,
            beyond=sight.beyond,
            seen_ns=sight.seen_ns,
            unconfirmed=self.waits,
        )

    def note_sent(self, command: Twist | None, ended: str = "") -> None:
        """Pass the sent command to the navigator, None when the lines were let go, and why a drive has `ended`."""
        if command is None:
            self.navigator.at_rest()
        else:
            self.navigator.commanded(command)
        if ended:
            self.drop(ended)


def _within(settings: PilotSettings, stops: StopTable | None) -> NavigatorSettings:
    """Return the navigator's settings with the rider's comfort limits, within the chair's measured stops."""
    dwa, limits = settings.navigator.dwa, settings.limiter
    comfortable = replace(
        dwa,
        max_speed=limits.max_speed,
        max_reverse=min(dwa.max_reverse, permitted_speed(stops)),
        max_omega=limits.max_omega,
        acceleration=limits.acceleration,
        braking=limits.braking,
        alpha=limits.alpha,
        jerk=limits.jerk,
        alpha_jerk=min(dwa.alpha_jerk, limits.jerk * limits.alpha / limits.acceleration),
        max_lateral=limits.lateral,
    )
    return replace(settings.navigator, dwa=measured(comfortable, stops))
