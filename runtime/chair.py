"""The whole chair as one object: sensor messages in, commands to the board out, one tick at a time.

It has no clock and no threads of its own. Its owner (a trial or the page) calls `step` at `topics.COMMAND.rate_hz` with
the messages since the last tick, and `beat` in between, at `topics.TELEMETRY.rate_hz` or faster, as a heartbeat for the
board. In ROS the same three parts, base, localiser and pilot, are processes.

No drive begins by the request alone: `go` takes a goal, and `confirm`, the rider's own yes, begins the drive if nothing
is wrong at that moment. Otherwise the goal is dropped. Everything that ends a drive drops its goal, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.fits.dac import DacModel
from waychair.config import setting
from waychair.control.drive.navigator import Navigator
from waychair.control.haptics.guide_types import StickHold
from waychair.control.haptics.next_door import NO_DOORWAYS, DoorSide, next_door, no_door
from waychair.control.safety.guard import Unscanned
from waychair.control.safety.stops import Halt
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.transports import Reconnecting
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import unscanned_points
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.runtime.chair_state import ChairState, ChairWatcher, Watchers
from waychair.runtime.drive_base import ChairMessage, DriveBase
from waychair.runtime.haptics.haptic_guide import HapticGuide
from waychair.runtime.haptics.haptic_state import HapticInputs
from waychair.runtime.monitor_process import MonitorPort
from waychair.runtime.perception import CellInputs, Perception
from waychair.runtime.pilot import Pilot, PilotSettings
from waychair.runtime.rider.guard_view import GuardView, guard_view
from waychair.slam.localising.kidnap_recovery import SavedMap
from waychair.slam.localising.localiser import (
    Localisation,
    LocalisationState,
    Localiser,
    LocaliserSettings,
    prepared_map,
)
from waychair.types import (
    Goal,
    HelpLevel,
    OccupancyGrid,
    Place,
    Pose2,
    RgbdFrame,
    Scan,
    ServoMessage,
    SonarReadings,
    Telemetry,
)

__all__ = [
    "NOBODY_LEADS",
    "Chair",
    "ChairSettings",
    "ChairState",
    "ChairWatcher",
    "PreparedStorey",
    "Watchers",
    "perceive_field",
]

NOBODY_LEADS = "this chair has no glove and no voice to lead you by: start it with a rider's file (--haptics)"


def perceive_field() -> bool:
    """Make the field for the switch of the behaviour cells, which the chair and the cells node share."""
    return setting(
        False,
        "",
        "whether behaviour cells tell a rider who cannot see of obstacles, free ways and doorways: true or false",
    )


@dataclass(frozen=True, slots=True)
class ChairSettings(PilotSettings):
    """The settings of the pilot, the drive base and the localiser, and the switch of the behaviour cells."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    perceive: bool = perceive_field()


@dataclass(frozen=True, slots=True)
class PreparedStorey:
    """Everything of a chair that belongs to one storey's map, made ready for `Chair.change_storey`."""

    pilot: Pilot
    known: SavedMap
    zones: tuple[Zone, ...]


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
        haptics: HapticGuide | None = None,
        cells: str = "default",
    ) -> None:
        """See `DriveBase` and `Pilot`; `start` None: the localiser searches the whole map.

        `scanned` is the map without the depth camera's cells, for the localiser; default: `grid`. `watcher` gets every request and
        every tick; steering shows in the state's verdict. `haptics` tells and leads a rider without sight. `cells`: their network.

        Raises:
            BridgeError: the chair's name is too long for a board.
        """
        self.settings = s = settings or ChairSettings()
        self._calibration = calibration
        self._base = DriveBase(
            calibration=calibration,
            cable=cable,
            start=start or Pose2(),
            settings=s,
            model=model,
            monitor=monitor,
            zones=zones,
        )
        known = grid if scanned is None else scanned
        self._pilot = Pilot(
            grid=grid,
            places=places,
            body=calibration.body,
            settings=s,
            stops=calibration.stops,
            zones=zones,
            tops=unscanned_points(grid, known),
        )
        self._localiser = Localiser(known, calibration.body.base_from_laser, start, s.localiser)
        self._localisation: Localisation | None = None
        self._watcher = watcher
        self._perception = Perception(calibration.body, network=cells) if s.perceive else None
        self.haptics = haptics

    def add_watcher(self, watcher: ChairWatcher) -> None:
        """Let one more watcher see every request and tick."""
        self._watcher = Watchers(self._watcher, watcher)

    @property
    def bridge(self) -> Bridge:
        """The computer's end of the cable to the board."""
        return self._base.bridge

    @property
    def navigator(self) -> Navigator:
        """The navigator, which plans paths and follows them."""
        return self._pilot.navigator

    @property
    def ready(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return self._base.ready

    def go(self, goal: Goal, *further: Goal) -> None:
        """Take a goal, or a list of them, which waits for `confirm`; a drive under way comes to rest first.

        Raises:
            UnknownPlace: a goal's place is not on the map.
            GoalTooExact: a goal's tolerance is smaller than a chair can stop within.
        """
        self._pilot.go(goal, *further)
        self._base.request()
        self._tell("go", (goal, *further))

    def confirm(self) -> None:
        """Take the rider's yes to the waiting goal: the drive begins in the next tick, unless something is wrong."""
        self._tell("confirm")
        if self._pilot.waits:
            self._base.confirm()

    @property
    def waits(self) -> bool:
        """Whether a goal waits for the rider's yes."""
        return self._pilot.waits

    def countdown_s(self, now_ns: int) -> float | None:
        """Return the time until a drive that has begun may move [s]; None outside the countdown."""
        return self._base.countdown_s(now_ns)

    def cancel(self) -> None:
        """Come to rest and drop the goal."""
        self._tell("cancel")
        self._pilot.drop("the drive was cancelled")

    def pause(self) -> bool:
        """Come to rest in comfort and stand, the goal kept, until `go_on`; return whether there is a drive to pause.

        A paused drive ends for the same reasons as any other: the rider's joystick takes it over.
        """
        return self._pilot.pause()

    def go_on(self) -> bool:
        """Let the paused drive go on, or take the other way that is offered, by a person's deliberate act.

        Return whether there is one.
        """
        return self._pilot.go_on()

    def choose_level(self, level: HelpLevel) -> str:
        """Take a level of help by the rider's own act, at once; return the sentence to be spoken."""
        self._tell(f"level {level.value}")
        return self._base.choose_level(level)

    def override_guard(self, now_ns: int) -> tuple[bool, str]:
        """Let the rider creep against the guard's caps, by the rider's own act; return whether it may, and the sentence."""
        self._tell("override")
        return self._base.guard.override(now_ns)

    def hold_stick(self, hold: StickHold, now_ns: int) -> None:
        """Hold the stick as the guidance asks for a moment, at the level guide; see `RiderGuard.hold_stick`."""
        self._base.guard.hold_stick(hold, now_ns)

    def offer_level(self, level: HelpLevel) -> None:
        """Offer the level of help that the rider chose on another day; it begins by `choose_level` only."""
        self._base.guard.offer(level)

    @property
    def level(self) -> HelpLevel:
        """The level of help now; the guard ends by itself where board or cable end it (`level_told`)."""
        return self._base.guard.level

    @property
    def level_told(self) -> str:
        """The last sentence about the level of help."""
        return self._base.guard.told

    def guard_view(self, telemetry: Telemetry | None) -> GuardView:
        """Return the level of help and the board's guard for a page, by the board's last report."""
        return guard_view(self._base.guard, telemetry)

    def lead(self, goal: Place) -> str:
        """Lead the driving rider to a place by touch and voice, by the rider's own act; return a sentence about it.

        At the level guard the rider is guarded and led from now on; at the level inform there is no guard either.
        """
        if self.haptics is None:
            return NOBODY_LEADS
        self._begin_to_lead("lead", goal, self.haptics.lead)
        return f"You are led to {goal.name}."

    def lead_through(self, side: DoorSide) -> tuple[bool, str]:
        """Lead the driving rider through the next doorway on a side, by odometry and what the lidar shows; no map is used.

        Return whether there is one, and a sentence about it.
        """
        if self.haptics is None:
            return False, NOBODY_LEADS
        if self._perception is None:
            return False, NO_DOORWAYS
        goal = next_door(self._perception.doorways, self.odom_from_base, side, self._calibration.body)
        if goal is None:
            return False, no_door(side)
        self._begin_to_lead("lead through", goal, self.haptics.lead_by_odometry)
        return True, f"You are led through {goal.name}."

    def _begin_to_lead(self, what: str, goal: Place, lead: Callable[[Place], None]) -> None:
        """Note the rider's request, guide a rider that was only guarded, and lead."""
        self._tell(what, (Goal(goal.name),))
        if self.level is HelpLevel.GUARD:
            self._base.choose_level(HelpLevel.GUIDE)
        lead(goal)

    def stop(self) -> None:
        """Obey the rider's Stop: nothing moves by itself until a new goal is asked for or a page steers."""
        self._tell("stop")
        self._base.stop()
        if self.haptics is not None:
            self.haptics.end("Stop was pressed")

    def steer(self, forward: float, turn: float, now_ns: int) -> None:
        """Take the position of a page's joystick; see `DriveBase.steer`."""
        self._base.steer(forward, turn, now_ns)

    def let_go(self, now_ns: int) -> None:
        """Note that a page's joystick was let go."""
        self._base.let_go(now_ns)

    def want_door(self, wanted: bool) -> None:
        """Let the behaviour cells lead the rider through a doorway, or no longer; nothing without them."""
        if self._perception is not None:
            self._perception.door_wanted = wanted

    def watch(self, messages: Iterable[ServoMessage]) -> None:
        """Pass messages of the camera on servos to the behaviour cells, for the next step; nothing without them.

        The cells' order to the camera is in the state after the step (`Perceived.order`).
        """
        if self._perception is not None:
            for message in messages:
                self._perception.watch(message, self._base.motion.odom_from_base(message.stamp_ns))

    def relocalise(self, map_from_base: Pose2 | None) -> None:
        """Localise anew, near a pose in map or, with None, on the whole map."""
        self._localiser.restart(map_from_base)

    def reset(self) -> None:
        """Reset faults and the emergency stop, by a person's deliberate act.

        No drive begins by it: a goal that was waiting has to be asked for again.
        """
        self._pilot.drop("the faults were reset; request the goal again")
        self._tell("reset")
        self._base.reset()

    def drawn(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> DrawnMap:
        """Prepare a map for `redraw`; takes a while, and may be called from any thread."""
        return self._pilot.drawn(grid, zones)

    def known(self, scanned: OccupancyGrid) -> SavedMap:
        """Prepare the localiser's map for `redraw`; takes a while, and may be called from any thread."""
        return prepared_map(scanned, self.settings.localiser)

    def redraw(
        self, drawn: DrawnMap, zones: Sequence[Zone], places: Mapping[str, Place], known: SavedMap | None = None
    ) -> None:
        """Replace places, zones and the planner's map; `known`, where something was erased, also the localiser's."""
        self._base.replace_zones(zones)
        self._pilot.redraw(drawn, places)
        if self.haptics is not None:
            self.haptics.redraw(self._pilot.navigator.grid, zones)
        if known is not None:
            self._localiser.replace_map(known)

    def prepared_storey(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        zones: Sequence[Zone] = (),
        scanned: OccupancyGrid | None = None,
    ) -> PreparedStorey:
        """Prepare another storey's map for `change_storey`; takes a while, and may be called from any thread."""
        body, stops = self._calibration.body, self._calibration.stops
        seen = grid if scanned is None else scanned
        tops = unscanned_points(grid, seen)
        pilot = Pilot(grid=grid, places=places, body=body, settings=self.settings, stops=stops, zones=zones, tops=tops)
        return PreparedStorey(pilot, prepared_map(seen, self.settings.localiser), tuple(zones))

    def change_storey(self, storey: str, prepared: PreparedStorey, map_from_base: Pose2 | None) -> None:
        """Take another storey's map, places, zones, planner and localiser at once, without anything seen on the last one.

        `map_from_base`: the chair's pose on the new map, from which it localises; None: on the whole map. The odometry
        goes on. A drive under way is dropped.
        """
        self._pilot.drop("the chair is on another storey: ask for the goal again")
        self._tell(f"storey {storey}")
        self._pilot = prepared.pilot
        self._localiser.replace_map(prepared.known)
        self._localiser.restart(map_from_base)
        self._localisation = None
        self._base.change_map(prepared.zones, map_from_base or Pose2())
        if self.haptics is not None:
            self.haptics.end("the chair is on another storey")
            self.haptics.redraw(prepared.pilot.navigator.grid, prepared.zones)

    def doubt_storey(self, *, certain: bool) -> None:
        """Note that the chair may leave the storey of its map, or is on it again; a journey's owner begins no drive meanwhile."""
        self._tell("storey certain" if certain else "storey uncertain")

    @property
    def odom_from_base(self) -> Pose2:
        """The chair's pose by wheels and gyro alone, which no change of the map touches."""
        odometry = self._base.motion.odometry
        return Pose2() if odometry is None else odometry.odom_from_base

    def beat(self, now_ns: int) -> None:
        """Send the board a heartbeat between two ticks."""
        self._base.beat(now_ns)

    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt] = ()) -> ChairState:
        """Run one tick: take in the messages, decide on the driver, and send the command.

        `other_halts` are halts that only the caller knows of, such as that of a page that is gone.
        """
        heard = tuple(messages)
        for message in heard:
            self._take_in(self._base.with_true_stamp(message))
        pose = self._base.motion.map_from_base(now_ns)
        self._pilot.expire(now_ns)
        verdict, telemetry = self._base.supervise(now_ns, self._pilot.navigator.active, other_halts)
        if self._base.stopped_after_push and self._is_degraded:
            self._localiser.restart(pose)  # after a push the scans match the pose only in part
        self._pilot.obey(verdict)
        if verdict.guarded:
            self._base.guard.unscanned = self._unscanned(pose)
        map_from_odom = None if self._localisation is None else self._localisation.map_from_odom
        navigation = self._pilot.step(now_ns, pose, map_from_odom)
        driven = self._base.drive(now_ns, verdict, navigation.twist if navigation.driving else None)
        self._pilot.note_sent(driven.command if driven.sent.active else None, driven.ended)
        perceived = None if self._perception is None else self._perception.step(now_ns, self._known(now_ns, telemetry))
        state = ChairState(
            stamp_ns=now_ns,
            map_from_base=pose,
            twist=self._base.motion.twist,
            localisation=self._localisation,
            verdict=verdict,
            halts=self._base.halts,
            navigation=navigation,
            command=driven.command,
            sent=driven.sent,
            telemetry=telemetry,
            perceived=perceived,
        )
        if self.haptics is not None:
            state = replace(state, haptics=(felt := self.haptics.step(self._haptic_inputs(state))))
            self.hold_stick(felt.hold, now_ns)
        if self._watcher is not None:
            self._watcher.note_tick(heard, state, self.bridge.greeting)
        return state

    def _haptic_inputs(self, state: ChairState) -> HapticInputs:
        """Return a tick's facts for the guide of a rider without sight."""
        found, telemetry, cells = state.localisation, state.telemetry, state.perceived
        knows = found is not None and found.state is not LocalisationState.LOST
        return HapticInputs(
            now_ns=state.stamp_ns,
            pose=state.map_from_base if knows else None,
            twist=state.twist,
            level=self.level,
            level_told=self.level_told,
            stick=None if telemetry is None else telemetry.joystick,
            guard=None if telemetry is None else telemetry.guard,
            signal=None if cells is None else cells.told,
            camera=None if cells is None else cells.camera,
            computer_drives=state.verdict.computer_drives and not state.verdict.steered,
            odom_from_base=self._base.motion.fresh_pose(state.stamp_ns),
            own_caps=self._base.guard.own_caps,
        )

    @property
    def _is_degraded(self) -> bool:
        """Whether the pose is uncertain; a localiser that is lost searches by itself."""
        return self._localisation is not None and self._localisation.state is LocalisationState.DEGRADED

    def _unscanned(self, map_from_base: Pose2) -> Unscanned:
        """Return the points that the guard watches beside the scans, in base: those of the map once localised, and seen walls."""
        known = Unscanned()
        if self._localisation is not None:  # the outline of a whole map is thinned before it is transformed
            known = self._pilot.unscanned.near((map_from_base.x, map_from_base.y)).seen_from(map_from_base)
        return known if self.haptics is None else self.haptics.with_seen(known, self.odom_from_base)

    def _tell(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        if self._watcher is not None:
            self._watcher.note_request(what, goals)

    def _take_in(self, message: ChairMessage) -> None:
        """Pass a message to the base, and scans, sonars and pictures to localiser, pilot and cells as well."""
        base, cells = self._base, self._perception
        base.hear(message)
        if isinstance(message, Scan) and base.motion.odometry is not None:
            scan = self._calibration.masked(message)
            odom_from_base = base.motion.odom_from_base(scan.stamp_ns)
            self._localisation = self._localiser.process(scan, odom_from_base, base.motion.twist)
            base.locate(self._localisation, scan.stamp_ns)
            self._pilot.see(scan, self._localisation, base.motion.twist)
            base.note_mapped_legs(self._pilot.mapped_legs, scan.stamp_ns)
            if self.haptics is not None:
                known = None if self._localisation.state is LocalisationState.LOST else self._localisation.map_from_base
                self.haptics.see(scan, known, odom_from_base, base.motion.twist)
            if cells is not None:
                cells.see(scan, odom_from_base)
        elif isinstance(message, SonarReadings):
            if self._localisation is not None:
                self._pilot.hear(message, base.motion.map_from_base(message.stamp_ns))
            if cells is not None:
                cells.hear(message, base.motion.odom_from_base(message.stamp_ns))
        elif isinstance(message, RgbdFrame):
            ground, tilt = None, base.motion.tilt
            if self._localisation is not None:
                ground = self._pilot.look(message, base.motion.map_from_base(message.stamp_ns), tilt)
            if cells is not None:
                cells.look(message, base.motion.odom_from_base(message.stamp_ns), tilt, ground)

    def _known(self, now_ns: int, telemetry: Telemetry | None) -> CellInputs:
        """Return the cells' inputs besides the messages."""
        motion, navigator = self._base.motion, self._pilot.navigator
        return CellInputs(
            odometry=motion.odometry,
            odom_from_base=motion.odom_from_base(now_ns),
            localisation=self._localisation,
            grid=navigator.grid,
            people=navigator.people,
            stick=None if telemetry is None else telemetry.joystick,
        )
