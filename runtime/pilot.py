"""The half of a chair that knows where to go: goals that wait for a yes, what is in the way, and the navigator.

It is told where the chair is and what its sensors see, and asks for a twist each tick. Whether it drives is not its to
say: it obeys the verdict of the `DriveBase`, and what that interrupts or refuses is dropped and never resumes by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.calibration.stopping import StopTable, permitted_speed
from waychair.config import setting
from waychair.control.collision_monitor import points_now, slim_beams
from waychair.control.navigator import Navigation, Navigator, NavigatorSettings, Stage
from waychair.control.supervisor import Verdict
from waychair.geometry import transform_points
from waychair.maps.zones import Zone
from waychair.planning.drawn_map import DrawnMap
from waychair.planning.motion import measured
from waychair.runtime.drive_base import BaseSettings
from waychair.runtime.echoes import Echoes, EchoSettings
from waychair.slam.localisation import Localisation, LocalisationState
from waychair.slam.scan_points import beam_ends
from waychair.slam.tilt import Tilt
from waychair.types import FloatArray, Goal, OccupancyGrid, Place, Pose2, RgbdFrame, Scan, SonarReadings, Twist


@dataclass(frozen=True, slots=True)
class PilotSettings(BaseSettings):
    """The navigator's own settings, beside the limits of the base that it plans within."""

    navigator: NavigatorSettings = field(default_factory=NavigatorSettings)
    echoes: EchoSettings = field(default_factory=EchoSettings)
    paused_s: float = setting(300.0, "s", "a drive that was paused is given up after so long", low=1.0, high=86400.0)


_NOTHING: FloatArray = np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class _Sight:
    """What a scan saw, (N, 2) [m] in map, how far its other beams went, (M, 2), and when; None when there was no scan."""

    points: FloatArray | None = None
    beyond: FloatArray | None = None
    seen_ns: int | None = None


class Pilot:
    """Takes goals to where they are on a map."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        settings: PilotSettings | None = None,
        stops: StopTable | None = None,
        zones: Sequence[Zone] = (),
    ) -> None:
        """stops: as measured on this chair; without them it crawls. `zones` are the map's."""
        self.settings = settings or PilotSettings()
        self.body = body
        self.navigator = Navigator(grid, places, body, _within(self.settings, stops), zones)
        self._goals: tuple[Goal, ...] = ()  # that wait for a yes
        self._goals_since_ns: int | None = None
        self._paused_since_ns: int | None = None
        self._sight = _Sight()  # since the last tick
        self._echoes = Echoes(self.settings.echoes)
        self.furniture = _NOTHING
        """(N, 2) [m] in the base of the latest scan: what of it might be legs but has always stood there, by a sure place."""

    def go(self, goal: Goal, *further: Goal) -> None:
        """Take a goal, and those after it, which wait for the rider's yes.

        Raises:
            UnknownPlace: one is not on the map.
            GoalTooExact: one is to be reached more closely than a chair can stop.
        """
        self.navigator.go(goal, *further)
        self._goals, self._goals_since_ns = (goal, *further), None

    @property
    def waits(self) -> bool:
        """Whether there is a goal to say yes to."""
        return bool(self._goals)

    def pause(self) -> bool:
        """Have a drive under way come to rest, and stand until `go_on`; whether there is one."""
        if self.waits or not self.navigator.active:
            return False
        self.navigator.pause()
        return True

    def go_on(self) -> bool:
        """Have a paused drive go on; whether there is one."""
        paused = self.navigator.stage is Stage.PAUSED
        self.navigator.resume()
        return paused

    def drop(self, reason: str) -> None:
        """Give up what was asked for."""
        self._goals = ()
        self.navigator.cancel(reason)

    def drawn(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> DrawnMap:
        """A map made ready for `redraw`; takes a while, and may be called from any thread."""
        return DrawnMap(grid, self.body, self.navigator.settings.costmap, zones)

    def redraw(self, drawn: DrawnMap, places: Mapping[str, Place]) -> None:
        """Go on by another drawing of the map; a drive under way is planned anew, one that has ended stays so."""
        self.navigator.redraw(drawn, places)

    def see(self, scan: Scan, localisation: Localisation, twist: Twist) -> None:
        """Told what a scan shows but for the chair itself, and where it was taken."""
        reach, mount = self.settings.navigator.obstacle_range, self.body.base_from_laser
        reach = min(reach, scan.range_max) if scan.range_max > 0.0 else reach
        # of a beam that goes on so far is known that it goes on so far
        clear = scan.ranges >= reach
        within = replace(scan, ranges=np.where(clear, np.float32(0.999 * reach), scan.ranges))
        ends, valid = beam_ends(within, mount, reach, twist)
        pose = localisation.map_from_base
        self.furniture = (
            self._mapped_legs(scan, pose, twist) if localisation.state is LocalisationState.OK else _NOTHING
        )
        halfway_ns = round(scan.time_step * len(scan.ranges) / 2 * 1e9)
        self._sight = _Sight(
            transform_points(pose, ends[valid & ~clear]),
            transform_points(pose, ends[valid & clear]),
            scan.stamp_ns + halfway_ns,
        )

    def _mapped_legs(self, scan: Scan, pose: Pose2, twist: Twist) -> FloatArray:
        s = self.settings.monitor
        slim = slim_beams(scan, np.zeros(len(scan.ranges), np.bool_), s)
        points = points_now(scan, slim, self.body, twist, scan.stamp_ns)
        mapped: FloatArray = points[self.navigator.knows(transform_points(pose, points), s.furniture)]
        return mapped

    def hear(self, readings: SonarReadings, map_from_base: Pose2) -> None:
        """Told what the sonars say; what is said once only does not count."""
        self.navigator.hear(self._echoes.borne_out(readings), map_from_base)

    def look(self, frame: RgbdFrame, map_from_base: Pose2, tilt: Tilt | None) -> None:
        """Told what the depth camera sees, and how the chair leans, if that is known."""
        self.navigator.look(frame, map_from_base, None if tilt is None else tilt.level_from_base())

    def expire(self, now_ns: int) -> None:
        """A goal waits for its yes for so long only, and a paused drive for going on."""
        if self.navigator.stage is not Stage.PAUSED:
            self._paused_since_ns = None
        elif self._paused_since_ns is None:
            self._paused_since_ns = now_ns
        elif now_ns - self._paused_since_ns > self.settings.paused_s * 1e9:
            self.drop("the drive was paused for too long: ask for the goal again")
        if not self._goals:
            return
        self._goals_since_ns = now_ns if self._goals_since_ns is None else self._goals_since_ns
        if now_ns - self._goals_since_ns > self.settings.supervisor.confirm_s * 1e9:
            self.drop("nobody has confirmed the drive: ask for the goal again")

    def obey(self, verdict: Verdict) -> None:
        """Begin what was said yes to, or drop what was interrupted or refused."""
        if verdict.drops_goal or not self.navigator.active:
            self.drop(verdict.reason)
        elif verdict.computer_drives and self._goals:
            self.navigator.go(*self._goals)  # afresh: what it tried while it waited does not count
            self._goals = ()

    def step(self, now_ns: int, map_from_base: Pose2, map_from_odom: Pose2 | None) -> Navigation:
        """The next twist to ask for."""
        sight, self._sight = self._sight, _Sight()
        return self.navigator.step(now_ns, map_from_base, sight.points, map_from_odom, sight.beyond, sight.seen_ns)

    def learn(self, command: Twist | None, ended: str = "") -> None:
        """What was really sent is news to the navigator; None: the lines were let go. So is why a drive has `ended`."""
        if command is None:
            self.navigator.at_rest()
        else:
            self.navigator.commanded(command)
        if ended:
            self.drop(ended)


def _within(settings: PilotSettings, stops: StopTable | None) -> NavigatorSettings:
    """The navigator plans within the rider's comfort and what the chair's brakes were measured for.

    It gives way to people for as long as the monitor does.
    """
    navigator, limits = settings.navigator, settings.limiter
    dwa = measured(navigator.dwa, stops)
    return replace(
        navigator,
        tracks=replace(navigator.tracks, room_after_s=settings.monitor.give_way_s),
        dwa=replace(
            dwa,
            max_speed=min(dwa.max_speed, limits.max_speed),
            max_reverse=min(dwa.max_reverse, permitted_speed(stops)),
            max_omega=min(dwa.max_omega, limits.max_omega),
            acceleration=min(dwa.acceleration, limits.acceleration),
            braking=min(dwa.braking, limits.braking),
            alpha=min(dwa.alpha, limits.alpha),
            jerk=min(dwa.jerk, limits.jerk),
            alpha_jerk=min(dwa.alpha_jerk, limits.jerk * limits.alpha / limits.acceleration),
            max_lateral=min(dwa.max_lateral, limits.lateral),
        ),
    )
