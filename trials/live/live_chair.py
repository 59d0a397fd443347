"""A simulated chair in real time behind the interface of the rider's page, without ROS and without hardware.

    with LiveChair("small_clinic") as chair:
        chair.go("reception")
        chair.confirm()

The shipped firmware runs between the chair and the simulated lines. Pages make the same requests as to a real chair.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.journey.journey import Leg
from waychair.errors import WaychairError
from waychair.firmware_bridge.heartbeat import urgent
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.runtime.pages.chair_display import ChairDisplay
from waychair.runtime.pages.chair_port import ChairView, GoalView, LayoutView, PortAnswer
from waychair.runtime.pages.drawing_port import NO_GUIDE, NOT_ASKED, DrawingPort
from waychair.runtime.pages.guard_port import GuardPort
from waychair.runtime.pages.haptic_port import HapticPort
from waychair.runtime.pages.perception_view import PerceptionView, drawn_network, surroundings
from waychair.runtime.rider.habits import Habits
from waychair.runtime.rider.kept_level import KeptLevel
from waychair.runtime.rider.sentences import GOES_ON, NOTHING_PAUSED, NOTHING_TO_PAUSE, PAUSED, sentence
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.simulator import SimulationSettings, Simulator
from waychair.topics import IMU
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, black_box, look_round, simulated_chair
from waychair.trials.guiding.live_haptics import HapticOptions, haptics_of
from waychair.trials.live.computer_joystick import SteersByComputer
from waychair.trials.live.latest_senses import LatestCells, LatestPicture, with_pictures
from waychair.trials.live.live_journeys import LiveBuilding, LiveJourneys
from waychair.trials.live.live_map import LiveMap, plan_folder
from waychair.trials.live.live_panel import BEFORE_START, panel_figures
from waychair.trials.live.page_stick import PageStickPort
from waychair.trials.live.real_time import RealTimeLoop
from waychair.types import DriveMode, FloatArray, Goal, OccupancyGrid, Place, Pose2, SensorMessage

COUNTDOWN_S = 3.0
"""Time from the rider's confirmation to the first motion."""


@dataclass(frozen=True, slots=True)
class _Blueprint:
    """The parts and options from which the chair's thread builds the simulated chair; see `LiveChair`."""

    world: World
    settings: ChairSettings
    map_folder: Path | None
    box: Path | None
    seed: int
    camera: bool
    urgently: bool
    simulation: SimulationSettings
    building: LiveBuilding | None
    habits: Habits | None
    haptics: HapticOptions | None
    stick: Path | None


class LiveChair(DrawingPort, GuardPort, HapticPort, PageStickPort):
    """A `ChairPort` of a chair in a simulated world; a context manager."""

    def __init__(
        self,
        world: str | Path | World,
        map_folder: Path | None = None,
        seed: int = 0,
        people: bool = True,
        *,
        camera: bool = False,
        countdown_s: float = COUNTDOWN_S,
        box: Path | None = None,
        urgently: bool = False,
        settings: ChairSettings | None = None,
        simulation: SimulationSettings | None = None,
        building: LiveBuilding | None = None,
        habits: Habits | None = None,
        kept_level: KeptLevel | None = None,
        haptics: HapticOptions | None = None,
        stick: Path | None = None,
    ) -> None:
        """Load the world; the chair starts with the block.

        `map_folder`: a map of a drive that began at the world's start. Without it the chair uses the world's plan, and
        drawings on it are lost at the end. `camera`: with pictures to look at. `box`: folder of a black box.
        `urgently`: with real-time priority, if the system grants it. `settings` are the chair's; `countdown_s` applies
        unless they give a countdown. `simulation`: the settings of the simulated sensors and plant. `building`: the chair
        travels over its storeys, from the world, which is one of its levels, on its maps instead of `map_folder`. `habits`:
        the rider's record. `haptics`: a rider without sight is told and led. `kept_level`: the rider's last level of help, which
        is offered. `stick`: a joystick of this computer moves the chair's own.

        Raises:
            WorldError: the world does not exist.
        """
        place = world if isinstance(world, World) else load_world(world)
        settings = settings or ChairSettings()
        supervisor = replace(settings.supervisor, countdown_s=settings.supervisor.countdown_s or countdown_s)
        self._blueprint = _Blueprint(
            world=place if people else place.without_people(),
            settings=replace(settings, supervisor=supervisor),
            map_folder=map_folder,
            box=box,
            seed=seed,
            camera=camera,
            urgently=urgently,
            simulation=simulation or SimulationSettings(),
            building=building,
            habits=habits,
            haptics=haptics,
            stick=stick,
        )
        self._kept_level = kept_level or KeptLevel()
        self._view = BEFORE_START
        self._picture = LatestPicture()
        self._cells = LatestCells()
        self._started = threading.Event()
        self._failure: Exception | None = None
        self._first_map: LiveMap
        self._journeys: LiveJourneys | None = None
        self._simulator: Simulator
        self._chair: Chair
        self._display: ChairDisplay
        self._loop: RealTimeLoop
        self._thread = threading.Thread(target=self._run, name="live chair", daemon=True)

    def __enter__(self) -> Self:
        """Start the chair's thread.

        Raises:
            WaychairError: the map cannot be read, or the firmware cannot be built.
        """
        self._thread.start()
        self._started.wait()
        if self._failure is not None:
            self._thread.join()
            raise self._failure
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the chair and release the lines.

        Raises:
            Exception: the exception that ended the chair's thread.
        """
        self._loop.end()
        self._thread.join()
        if self._failure is not None and error is None:
            raise self._failure

    @property
    def outline(self) -> FloatArray:
        """See `ChairPort`."""
        return CHAIR_A.outline()

    @property
    def alive(self) -> bool:
        """Whether the chair's thread runs; `__exit__` raises the cause if it does not."""
        return self._thread.is_alive()

    @property
    def simulator(self) -> Simulator:
        """The simulator, for tests that push the chair, use its joystick or read the true pose."""
        return self._simulator

    def view(self) -> ChairView:
        """See `ChairPort`."""
        return self._view

    @property
    def _map(self) -> LiveMap:
        """The map in use: that of the storey on which the chair is."""
        return self._first_map if self._journeys is None else self._journeys.map

    def grid(self) -> OccupancyGrid | None:
        """See `ChairPort`."""
        return self._map.grid

    def goals(self) -> Sequence[GoalView]:
        """See `ChairPort`."""
        return () if self._journeys is None else self._journeys.goals(self._view.map_from_base)

    def layout(self) -> LayoutView:
        """See `ChairPort`."""
        return self._map.layout()

    def picture(self) -> bytes | None:
        """See `ChairPort`."""
        return self._picture.jpeg()

    def perception(self) -> PerceptionView | None:
        """See `ChairPort`."""
        return self._cells.view()

    def network(self, name: str) -> str | None:
        """See `ChairPort`."""
        perceived = self._cells.perceived
        return None if perceived is None else drawn_network(perceived, name)

    def _led(self) -> tuple[Chair, Mapping[str, Place]]:
        return self._chair, self._map.drawing.places

    def go(self, goal: str | Pose2) -> PortAnswer:
        """See `ChairPort`; a goal of the building may lie on another storey."""
        label = goal if isinstance(goal, str) else f"{goal.x:.1f}, {goal.y:.1f}"
        journeys, legs, here = self._journeys, tuple[Leg, ...](), self._map
        if journeys is not None and isinstance(goal, str) and goal not in here.drawing.places:
            pose = self._view.map_from_base
            if pose is None:
                return PortAnswer(False, "the chair does not know where it is: drive it to a known place first")
            try:
                legs = journeys.legs(goal, journeys.traveller.storey, pose)
            except WaychairError as error:
                return PortAnswer(False, str(error))

        def asked() -> PortAnswer:
            if journeys is not None and (journeys.traveller.aboard or self._map is not here):
                return PortAnswer(
                    False, "the chair is in a lift: let it find out the storey, then choose the goal again"
                )
            self._chair.go(legs[0].goal if legs else Goal(goal))
            self._display.label = label
            if journeys is not None:
                journeys.ask(label, legs if len(legs) > 1 else ())
            self._loop.step()
            return PortAnswer(True, f"press Drive to go to {label}")

        return self._request(asked)

    def confirm(self, goal: str = "") -> PortAnswer:
        """See `ChairPort`."""

        def said() -> PortAnswer:
            label = self._display.label
            if not self._chair.waits:
                return PortAnswer(False, "there is no goal to confirm: choose a place first")
            if goal and goal != label:
                return PortAnswer(False, f"the goal is {label} now: check its path, then press Drive")
            self._loop.watch.began(time.monotonic_ns())
            if self._journeys is None or not self._journeys.begin(self._simulator.now_ns):
                self._chair.confirm()
            verdict = self._loop.step().verdict
            if verdict.computer_drives:
                return PortAnswer(
                    True, f"sets off to {label} in {self._blueprint.settings.supervisor.countdown_s:.0f} s"
                )
            if self._journeys is not None:
                self._journeys.traveller.drop()
            return PortAnswer(False, verdict.reason)

        return self._request(said)

    def pause(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            paused = self._chair.pause() if self._journeys is None else self._journeys.traveller.pause()
            self._loop.step()
            return PortAnswer(paused, PAUSED if paused else NOTHING_TO_PAUSE)

        return self._request(done)

    def go_on(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            if self._journeys is None:
                goes_on = self._chair.go_on()
            else:
                self._loop.watch.began(time.monotonic_ns())
                goes_on = self._journeys.traveller.go_on(self._simulator.now_ns)
            self._loop.step()
            return PortAnswer(goes_on, GOES_ON if goes_on else NOTHING_PAUSED)

        return self._request(done)

    def cancel(self) -> PortAnswer:
        """See `ChairPort`; in a lift the chair still finds out the storey."""

        def done() -> PortAnswer:
            if self._journeys is not None:
                self._journeys.traveller.cancel(self._simulator.now_ns)
            self._chair.cancel()
            self._loop.step()
            return PortAnswer(True, "the drive was cancelled")

        return self._request(done)

    def answer_storey(self, storey: str) -> PortAnswer:
        """See `ChairPort`."""
        journeys = self._journeys

        def done() -> PortAnswer:
            if journeys is None:
                return PortAnswer(False, NOT_ASKED)
            self._loop.watch.began(time.monotonic_ns())
            answer = journeys.answer(storey, self._view.asks, self._simulator.now_ns)
            self._loop.step()
            return answer

        return self._request(done)

    def start_at(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""
        journeys = self._journeys
        if journeys is None or goal in self._map.drawing.places:
            return DrawingPort.start_at(self, goal)
        try:
            storey, place = journeys.place(goal)
        except WaychairError as error:
            return PortAnswer(False, str(error))
        drives = self._view.mode is DriveMode.AUTONOMOUS
        return self._request(lambda: journeys.start_at(storey, place.pose, drives=drives))

    def guide(self, goal: str, level: int) -> PortAnswer:
        """See `ChairPort`."""
        journeys = self._journeys
        if journeys is None:
            return PortAnswer(False, NO_GUIDE)
        try:
            ways = journeys.guided_ways()  # in the caller's thread: no tick waits for it
        except WaychairError as error:
            return PortAnswer(False, str(error))
        return self._request(lambda: journeys.guide(goal, level, self._simulator.now_ns, ways))

    def end_guide(self) -> PortAnswer:
        """See `ChairPort`."""
        journeys = self._journeys
        if journeys is None:
            return PortAnswer(False, NO_GUIDE)
        return self._request(lambda: journeys.end_guide(self._simulator.now_ns))

    def stop(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            self._page_stick.end()
            if self._journeys is None:
                self._chair.stop()
            else:
                self._journeys.traveller.stop()
            self._loop.step()
            return PortAnswer(True, "stopped")

        return self._request(done, first=True)

    def reset(self) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            self._chair.reset()
            return PortAnswer(True, "the faults were reset; request the goal again")

        return self._request(done)

    def relocalise(self, map_from_base: Pose2 | None = None) -> PortAnswer:
        """See `ChairPort`."""

        def done() -> PortAnswer:
            self._chair.relocalise(map_from_base)
            return PortAnswer(True, "the chair relocalises")

        return self._request(done)

    def watched(self, pages: Sequence[str]) -> None:
        """See `ChairPort`."""
        self._loop.watch.seen(pages, time.monotonic_ns())

    def _guarded(self) -> tuple[Chair, int]:
        return self._chair, self._simulator.now_ns

    def _request(self, what: Callable[[], PortAnswer], first: bool = False) -> PortAnswer:
        if not self.alive:
            return PortAnswer(False, "the simulated chair has ended: start it again")
        try:
            return self._loop.ask(what, first)
        except WaychairError as error:
            return PortAnswer(False, str(error))

    def _drawn(self, change: Callable[[DrawingEditor], None], done: str) -> PortAnswer:
        known = self._map

        def tell(what: Callable[[], None]) -> None:
            """Change the chair's map, unless it is on another storey by now."""
            self._loop.ask(lambda: what() if self._map is known else None)

        answer = known.change(change, done, self._chair, tell)
        if answer.done and self._journeys is not None:
            self._journeys.redrawn(known)
        return answer

    def _run(self) -> None:
        """Run the chair; the thread's function."""
        try:
            with ExitStack() as ends:
                self._build(ends)
                self._started.set()
                if self._blueprint.urgently:
                    urgent()
                self._loop.run()
        except Exception as error:
            if self._started.is_set():  # else `__enter__` raises it
                logging.getLogger(__name__).exception("the simulated chair has failed")
            self._failure = error  # `__exit__` raises it again
            self._view = replace(
                self._view,
                mode=DriveMode.STOPPED,
                next_action="Stopped. The simulated chair has ended: start it again.",
                last_stop=sentence(f"the simulated chair has failed: {error}"),
                free_since_ns=time.monotonic_ns(),
            )
        finally:
            self._started.set()

    def _build(self, ends: ExitStack) -> None:
        plan, settings = self._blueprint, randomised_settings(self._blueprint.seed)
        site, maps, lifts = plan.building, dict[str, LiveMap](), None
        if site is not None:
            maps, lifts = site.maps(), site.lifts(plan.seed)
            settings = replace(settings, imu=replace(settings.imu, rate_hz=IMU.rate_hz))  # it feels the rides
            self._first_map = maps[plan.world.level]
        else:
            self._first_map = LiveMap(plan.map_folder or ends.enter_context(plan_folder(plan.world)))
        drawn = self._first_map.drawing
        setup = DriveSetup(
            grid=self._first_map.grid,
            places=drawn.places,
            body=CHAIR_A,
            calibration=DEFAULT,
            map_from_world=plan.world.start.inverse() if site is None and plan.map_folder is not None else Pose2(),
            chair=plan.settings,
            zones=drawn.zones,
            scanned=self._first_map.scanned(),
        )
        simulated = plan.simulation.over(with_pictures(settings, plan.camera))
        self._simulator = Simulator(plan.world, CHAIR_A, simulated, plan.seed, lifts)
        watcher = ends.enter_context(black_box(setup, plan.box))
        parts = ends.enter_context(haptics_of(plan.haptics, setup, plan.seed))
        self._chair = ends.enter_context(simulated_chair(setup, self._simulator, watcher, haptics=parts.guide))
        self._chair.offer_level(self._kept_level.level())
        self._display = ChairDisplay(self._chair, CHAIR_A.base_from_laser)
        if site is not None and lifts is not None:
            worker = ends.enter_context(ThreadPoolExecutor(1, "storeys"))
            here = plan.world.level, plan.world.start
            self._journeys = LiveJourneys(site, maps, self._chair, lifts, *here, worker, plan.habits)
        parts.tell_of(
            lambda: surroundings(self._map.drawing.places, self._cells.view()), lambda: self._simulator.contacts
        )
        has_rider = plan.stick is not None or (plan.haptics is not None and plan.haptics.driver is not None)
        beats = [parts.beat, self._give_stick(self._chair, self._simulator, has_rider=has_rider).beat]
        if plan.stick is not None:
            beats.append(ends.enter_context(closing(SteersByComputer(plan.stick))).beat)
        self._loop = RealTimeLoop(self._chair, self._simulator, self._after_tick, self._journeys, beats)

    def _after_tick(self, messages: tuple[SensorMessage, ...], state: ChairState) -> None:
        """Update view and picture after a tick."""
        journeys = self._journeys
        if journeys is not None and journeys.under_way:
            self._display.label = journeys.leg_label()
        if journeys is not None:
            journeys.tags.look(messages)
        self._display.hear(messages, state)
        self._picture.hear(messages)
        self._haptics = state.haptics
        self._cells.hear(state, look_round(self._simulator, self._chair, state))
        view = self._display.view(state)
        self._view = replace(
            view if journeys is None else journeys.shown(view),
            map_revision=self._map.revision,
            layout_revision=self._map.layout_revision,
            panel=panel_figures(state, self._loop.timing, self._simulator.contacts, self._map.grid.cells.size),
            free_since_ns=self._loop.free_since_ns,
        )
