"""The whole chair as one object: sensor messages in, commands to the board out, one tick at a time.

It has no clock and no threads of its own: whoever owns it (a trial, the page) calls `step` at `topics.COMMAND.rate_hz`
with the messages since the last tick, and `beat` in between, at `topics.TELEMETRY.rate_hz` or faster, so that the board
knows that the computer lives. As ROS nodes the same three parts, base, localiser and pilot, are processes.

Nothing drives because it was asked for: `go` takes a goal, and `confirm`, the rider's own yes, begins it, if nothing is
wrong at that moment. Otherwise the goal is dropped, and so it is by whatever ends a drive.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.dac import DacModel
from waychair.control.navigator import Navigation, Navigator
from waychair.control.stops import Halt
from waychair.control.supervisor import Verdict
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.protocol import HelloReply
from waychair.firmware_bridge.transports import Reconnecting
from waychair.maps.zones import Zone
from waychair.planning.drawn_map import DrawnMap
from waychair.runtime.drive_base import DriveBase, Message
from waychair.runtime.monitor_process import MonitorPort
from waychair.runtime.pilot import Pilot, PilotSettings
from waychair.slam.localiser import Localisation, LocalisationState, Localiser, LocaliserSettings, saved_map
from waychair.slam.recovery import SavedMap
from waychair.types import (
    Goal,
    OccupancyGrid,
    Place,
    Pose2,
    RgbdFrame,
    Scan,
    Sent,
    SonarReadings,
    Telemetry,
    Twist,
)


@dataclass(frozen=True, slots=True)
class ChairSettings(PilotSettings):
    """The parts' own settings."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)


@dataclass(frozen=True, slots=True)
class ChairState:
    """What the chair knows and did in one tick: where it is, who drives and why, what was asked and what was sent.

    `halts`: all that keeps it from driving or holds it up, each with its remedy. `command`: the navigator's twist
    within the limits, None when the computer does not drive. `telemetry` is the board's last report, None while there
    is no board that could be driven through.
    """

    stamp_ns: int
    map_from_base: Pose2
    twist: Twist
    localisation: Localisation | None
    verdict: Verdict
    halts: tuple[Halt, ...]
    navigation: Navigation
    command: Twist | None
    sent: Sent
    telemetry: Telemetry | None


class ChairWatcher(Protocol):
    """Who looks on while a chair drives, as a black box does. It must neither wait nor raise."""

    def told(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """Somebody asked for something: go (to these goals), confirm, cancel, stop or reset; nothing else is told."""

    def note(self, heard: tuple[Message, ...], state: ChairState, board: HelloReply | None) -> None:
        """A tick is over: what was heard in it, what came of it, and what the board said of itself."""


class Chair:
    """A chair on a known map, at the end of a cable to its board."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        calibration: ChairCalibration,
        cable: Reconnecting,
        start: Pose2 | None,
        settings: ChairSettings | None = None,
        model: DacModel | None = None,
        monitor: MonitorPort | None = None,
        zones: Sequence[Zone] = (),
        scanned: OccupancyGrid | None = None,
        watcher: ChairWatcher | None = None,
    ) -> None:
        """See `DriveBase` and `Pilot`; `start` None: it has to find out where it is.

        `scanned` is the map as a lidar sees it, where a camera has drawn into it, too; `watcher` is told what the chair
        is asked for (see `ChairWatcher.told`), and tick by tick what it hears and does: steering shows in who drives.

        Raises:
            BridgeError: the chair's name is too long for a board.
        """
        self.settings = s = settings or ChairSettings()
        self._calibration = calibration
        self._base = DriveBase(calibration, cable, start or Pose2(), s, model, monitor, zones)
        self._pilot = Pilot(grid, places, calibration.body, s, calibration.stops, zones)
        known = grid if scanned is None else scanned
        self._localiser = Localiser(known, calibration.body.base_from_laser, start, s.localiser)
        self._localisation: Localisation | None = None
        self._watcher = watcher

    @property
    def bridge(self) -> Bridge:
        """Its end of the cable."""
        return self._base.bridge

    @property
    def navigator(self) -> Navigator:
        """What it drives by."""
        return self._pilot.navigator

    @property
    def ready(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return self._base.ready

    def go(self, goal: Goal, *further: Goal) -> None:
        """Take a goal, and those after it, which wait for `confirm`; a drive under way comes to rest first.

        Raises:
            UnknownPlace: one is not on the map.
            GoalTooExact: one is to be reached more closely than a chair can stop.
        """
        self._pilot.go(goal, *further)
        self._base.request()
        self._tell("go", (goal, *further))

    def confirm(self) -> None:
        """The rider's yes to the goal that waits: the drive begins in the next tick, unless something is wrong."""
        self._tell("confirm")
        if self._pilot.waits:
            self._base.confirm()

    @property
    def waits(self) -> bool:
        """Whether there is a goal to say yes to."""
        return self._pilot.waits

    def countdown_s(self, now_ns: int) -> float | None:
        """Until the first motion of a drive that has begun [s]; None when it is not waited for."""
        return self._base.countdown_s(now_ns)

    def cancel(self) -> None:
        """Come to rest and give the goal up."""
        self._tell("cancel")
        self._pilot.drop("the drive was cancelled")

    def pause(self) -> bool:
        """Come to rest in comfort and stand, the goal kept, until `go_on`; whether there is a drive to pause.

        Whatever ends a drive ends this one, too: the rider's joystick takes it over.
        """
        return self._pilot.pause()

    def go_on(self) -> bool:
        """Somebody's deliberate act: the paused drive goes on; whether there is one."""
        return self._pilot.go_on()

    def stop(self) -> None:
        """The rider's Stop: nothing moves by itself until a new goal is asked for, or somebody steers."""
        self._tell("stop")
        self._base.stop()

    def steer(self, forward: float, turn: float, now_ns: int) -> None:
        """A page's joystick is held there; see `DriveBase.steer`."""
        self._base.steer(forward, turn, now_ns)

    def let_go(self, now_ns: int) -> None:
        """A page's joystick was let go."""
        self._base.let_go(now_ns)

    def relocalise(self, map_from_base: Pose2 | None) -> None:
        """Find out anew where the chair is, near a pose or anywhere."""
        self._localiser.restart(map_from_base)

    def reset(self) -> None:
        """Somebody's deliberate act: the faults were seen to, the emergency stop was released on purpose.

        Nothing drives because of it: a goal that was waiting for it has to be asked for again.
        """
        self._pilot.drop("the faults were reset; ask for the goal again")
        self._tell("reset")
        self._base.reset()

    def drawn(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> DrawnMap:
        """A map made ready for `redraw`; takes a while, and may be called from any thread."""
        return self._pilot.drawn(grid, zones)

    def known(self, scanned: OccupancyGrid) -> SavedMap:
        """The map as a lidar sees it, made ready for `redraw`; takes a while, and may be called from any thread."""
        return saved_map(scanned, self.settings.localiser)

    def redraw(
        self, drawn: DrawnMap, zones: Sequence[Zone], places: Mapping[str, Place], known: SavedMap | None = None
    ) -> None:
        """Other places and zones from now on, and what was erased of the map.

        known: where something was erased, what the chair knows its place by from now on.
        """
        self._base.zones = tuple(zones)
        self._pilot.redraw(drawn, places)
        if known is not None:
            self._localiser.redraw(known)

    def beat(self, now_ns: int) -> None:
        """Keep the board company between two ticks."""
        self._base.beat(now_ns)

    def step(self, now_ns: int, messages: Iterable[Message], further: Iterable[Halt] = ()) -> ChairState:
        """One tick: take in the messages, decide who drives, and let the bridge send what that comes to.

        `further` is what else stands against a drive, by those who know of it.
        """
        heard = tuple(messages)
        for message in heard:
            self._take_in(self._base.on_time(message))
        pose = self._base.map_from_base(now_ns)
        self._pilot.expire(now_ns)
        verdict, telemetry = self._base.supervise(now_ns, self._pilot.navigator.active, further)
        if self._base.stands_again and self._is_in_doubt:
            self._localiser.restart(pose)  # it was pushed, and what it sees does not quite bear out where to
        self._pilot.obey(verdict)
        map_from_odom = None if self._localisation is None else self._localisation.map_from_odom
        navigation = self._pilot.step(now_ns, pose, map_from_odom)
        driven = self._base.drive(now_ns, verdict, navigation.twist if navigation.driving else None)
        self._pilot.learn(driven.command if driven.sent.active else None, driven.ended)
        state = ChairState(
            now_ns,
            pose,
            self._base.twist,
            self._localisation,
            verdict,
            self._base.halts,
            navigation,
            driven.command,
            driven.sent,
            telemetry,
        )
        if self._watcher is not None:
            self._watcher.note(heard, state, self.bridge.greeting)
        return state

    @property
    def _is_in_doubt(self) -> bool:
        """One that is lost looks for itself by itself."""
        return self._localisation is not None and self._localisation.state is LocalisationState.DEGRADED

    def _tell(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        if self._watcher is not None:
            self._watcher.told(what, goals)

    def _take_in(self, message: Message) -> None:
        """To the base all of them; to the localiser and the navigator what they need to know."""
        base = self._base
        base.hear(message)
        if isinstance(message, Scan) and base.odometry is not None:
            scan = self._calibration.seen(message)
            odom_from_base = base.odom_from_base(scan.stamp_ns)
            self._localisation = self._localiser.process(scan, odom_from_base, base.twist)
            base.locate(self._localisation, scan.stamp_ns)
            self._pilot.see(scan, self._localisation, base.twist)
            base.furnish(self._pilot.furniture, scan.stamp_ns)
        elif isinstance(message, SonarReadings) and self._localisation is not None:
            self._pilot.hear(message, base.map_from_base(message.stamp_ns))
        elif isinstance(message, RgbdFrame) and self._localisation is not None:
            self._pilot.look(message, base.map_from_base(message.stamp_ns), base.tilt)
