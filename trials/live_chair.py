"""A simulated chair in real time behind the interface of the rider's page, without ROS and without hardware.

    with LiveChair("small_clinic") as chair:
        chair.go("reception")
        chair.confirm()

The shipped firmware runs between the chair and the simulated lines. Pages make the same requests as to a real chair.
"""

from __future__ import annotations

import logging
import resource
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import WaychairError
from waychair.firmware_bridge.heartbeat import urgent
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.runtime.chair_display import ChairDisplay
from waychair.runtime.chair_port import Answer, ChairView, LayoutView
from waychair.runtime.drawing_port import DrawingPort
from waychair.runtime.perception import Perceived
from waychair.runtime.perception_view import PerceptionView, drawn_network, perception_view
from waychair.runtime.sentences import GOES_ON, NOTHING_PAUSED, NOTHING_TO_PAUSE, PAUSED, sentence
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.simulator import SimulationSettings, Simulator, SimulatorSettings
from waychair.slam.localising.localisation import LocalisationState
from waychair.trials.demo import randomised_settings
from waychair.trials.drive import DriveSetup, black_box, look_round, simulated_chair
from waychair.trials.live_map import LiveMap, plan_folder
from waychair.trials.real_time import RealTimeLoop
from waychair.types import (
    DriveMode,
    FloatArray,
    Goal,
    OccupancyGrid,
    PanTiltAngles,
    Pose2,
    RgbdFrame,
    SensorMessage,
    ServoMessage,
    Twist,
)

COUNTDOWN_S = 3.0
"""Time from the rider's confirmation to the first motion."""

_PICTURES_HZ = 2.0
_BEFORE_START = ChairView(
    stamp_ns=0,
    map_from_base=None,
    localisation=LocalisationState.LOST,
    health=0.0,
    mode=DriveMode.MANUAL,
    twist=Twist(),
    next_action="The chair is starting.",
)


@dataclass(frozen=True, slots=True)
class _Blueprint:
    """The parts and options from which the chair's thread builds the simulated chair; see `LiveChair`."""

    world: World
    map_folder: Path | None
    box: Path | None
    seed: int
    camera: bool
    urgently: bool
    simulation: SimulationSettings


class _LatestPicture:
    """The camera's latest picture; it is encoded only when somebody looks at it."""

    def __init__(self) -> None:
        self._frame: RgbdFrame | None = None
        self._jpeg: tuple[int, bytes] | None = None

    def hear(self, messages: Sequence[SensorMessage]) -> None:
        """Take in the messages of a tick."""
        self._frame = next((each for each in reversed(messages) if isinstance(each, RgbdFrame)), self._frame)

    def jpeg(self) -> bytes | None:
        """Return the picture as JPEG; None before the first one."""
        frame, known = self._frame, self._jpeg
        if frame is None:
            return None
        if known is None or known[0] != frame.stamp_ns:
            done, data = cv2.imencode(".jpg", np.ascontiguousarray(frame.image[..., ::-1]))
            self._jpeg = known = frame.stamp_ns, bytes(data) if done else b""
        return known[1]


class _LatestCells:
    """The behaviour cells after the latest tick, and the servos' report; the view is made only when somebody looks."""

    def __init__(self) -> None:
        self.perceived: Perceived | None = None
        self._aim: PanTiltAngles | None = None

    def hear(self, state: ChairState, looked: Sequence[ServoMessage]) -> None:
        """Take in a tick."""
        self.perceived = state.perceived
        self._aim = next((each for each in reversed(looked) if isinstance(each, PanTiltAngles)), self._aim)

    def view(self) -> PerceptionView | None:
        """Return what a page shows; None without cells."""
        perceived = self.perceived
        return None if perceived is None else perception_view(perceived, CHAIR_A, self._aim)


class LiveChair(DrawingPort):
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
    ) -> None:
        """Load the world; the chair starts with the block.

        `map_folder`: a map of a drive that began at the world's start. Without it the chair uses the world's plan, and
        drawings on it are lost at the end. `camera`: with pictures to look at. `box`: folder of a black box.
        `urgently`: with real-time priority, if the system grants it. `settings` are the chair's; `countdown_s` applies
        unless they give a countdown. `simulation`: the settings of the simulated sensors and plant.

        Raises:
            WorldError: the world does not exist.
        """
        building = world if isinstance(world, World) else load_world(world)
        self._blueprint = _Blueprint(
            world=building if people else building.without_people(),
            map_folder=map_folder,
            box=box,
            seed=seed,
            camera=camera,
            urgently=urgently,
            simulation=simulation or SimulationSettings(),
        )
        settings = settings or ChairSettings()
        supervisor = replace(settings.supervisor, countdown_s=settings.supervisor.countdown_s or countdown_s)
        self._settings = replace(settings, supervisor=supervisor)
        self._view = _BEFORE_START
        self._picture = _LatestPicture()
        self._cells = _LatestCells()
        self._started = threading.Event()
        self._failure: Exception | None = None
        self._map: LiveMap
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

    def grid(self) -> OccupancyGrid | None:
        """See `ChairPort`."""
        return self._map.grid

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

    def go(self, goal: str | Pose2) -> Answer:
        """See `ChairPort`."""
        label = goal if isinstance(goal, str) else f"{goal.x:.1f}, {goal.y:.1f}"

        def asked() -> Answer:
            self._chair.go(Goal(goal))
            self._display.label = label
            self._loop.step()
            return Answer(True, f"press Drive to go to {label}")

        return self._request(asked)

    def confirm(self, goal: str = "") -> Answer:
        """See `ChairPort`."""

        def said() -> Answer:
            if not self._chair.waits:
                return Answer(False, "there is no goal to confirm: choose a place first")
            if goal and goal != self._display.label:
                return Answer(False, f"the goal is {self._display.label} now: check its path, then press Drive")
            self._loop.watch.began(time.monotonic_ns())
            self._chair.confirm()
            verdict = self._loop.step().verdict
            if verdict.computer_drives:
                return Answer(
                    True, f"sets off to {self._display.label} in {self._settings.supervisor.countdown_s:.0f} s"
                )
            return Answer(False, verdict.reason)

        return self._request(said)

    def pause(self) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            paused = self._chair.pause()
            self._loop.step()
            return Answer(paused, PAUSED if paused else NOTHING_TO_PAUSE)

        return self._request(done)

    def go_on(self) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            goes_on = self._chair.go_on()
            self._loop.step()
            return Answer(goes_on, GOES_ON if goes_on else NOTHING_PAUSED)

        return self._request(done)

    def cancel(self) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            self._chair.cancel()
            self._loop.step()
            return Answer(True, "the drive was cancelled")

        return self._request(done)

    def stop(self) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            self._chair.stop()
            self._loop.step()
            return Answer(True, "stopped")

        return self._request(done, first=True)

    def reset(self) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            self._chair.reset()
            return Answer(True, "the faults were reset; request the goal again")

        return self._request(done)

    def steer(self, forward: float, turn: float) -> Answer:
        """See `ChairPort`; the answer is based on the last tick."""
        self._loop.tell(lambda: self._chair.steer(forward, turn, self._simulator.now_ns))
        view = self._view
        if view.steered or not view.obstacles:
            return Answer(True, "")
        return Answer(False, view.obstacles[0].sentence)

    def release(self) -> Answer:
        """See `ChairPort`."""
        self._loop.tell(lambda: self._chair.let_go(self._simulator.now_ns))
        return Answer(True, "")

    def relocalise(self, map_from_base: Pose2 | None = None) -> Answer:
        """See `ChairPort`."""

        def done() -> Answer:
            self._chair.relocalise(map_from_base)
            return Answer(True, "the chair relocalises")

        return self._request(done)

    def watched(self, pages: Sequence[str]) -> None:
        """See `ChairPort`."""
        self._loop.watch.seen(pages, time.monotonic_ns())

    def _request(self, what: Callable[[], Answer], first: bool = False) -> Answer:
        if not self.alive:
            return Answer(False, "the simulated chair has ended: start it again")
        try:
            return self._loop.ask(what, first)
        except WaychairError as error:
            return Answer(False, str(error))

    def _drawn(self, change: Callable[[DrawingEditor], None], done: str) -> Answer:
        return self._map.change(change, done, self._chair, self._loop)

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
        folder = ends.enter_context(plan_folder(plan.world)) if plan.map_folder is None else plan.map_folder
        self._map = LiveMap(folder)
        drawn = self._map.drawing
        setup = DriveSetup(
            grid=self._map.grid,
            places=drawn.places,
            body=CHAIR_A,
            calibration=DEFAULT,
            map_from_world=Pose2() if plan.map_folder is None else plan.world.start.inverse(),
            chair=self._settings,
            zones=drawn.zones,
            scanned=self._map.scanned(),
        )
        simulated = plan.simulation.over(_with_pictures(settings, plan.camera))
        self._simulator = Simulator(plan.world, CHAIR_A, simulated, plan.seed)
        watcher = ends.enter_context(black_box(setup, plan.box))
        self._chair = ends.enter_context(simulated_chair(setup, self._simulator, watcher))
        self._display = ChairDisplay(self._chair, CHAIR_A.base_from_laser)
        self._map.prepare(self._chair)
        self._loop = RealTimeLoop(self._chair, self._simulator, self._after_tick)

    def _after_tick(self, messages: tuple[SensorMessage, ...], state: ChairState) -> None:
        """Update view and picture after a tick."""
        self._display.hear(messages, state)
        self._picture.hear(messages)
        self._cells.hear(state, look_round(self._simulator, self._chair, state))
        self._view = replace(
            self._display.view(state),
            map_revision=self._map.revision,
            layout_revision=self._map.layout_revision,
            panel=self._panel(state),
            free_since_ns=self._loop.free_since_ns,
        )

    def _panel(self, state: ChairState) -> dict[str, float]:
        """Return the figures of the engineer's panel."""
        timing, telemetry = self._loop.timing, state.telemetry
        figures = {
            "tick, mean [ms CPU]": 1e3 * timing.tick_s,
            "tick, longest [ms CPU]": 1e3 * timing.longest_tick_s,
            "late ticks": float(timing.late),
            "time lost [s]": timing.lost_s,
            "forward line [V]": state.sent.forward_volts,
            "turn line [V]": state.sent.turn_volts,
            "plans of this drive": float(state.navigation.plans),
            "contacts": float(self._simulator.contacts),
            "cells of the map": float(self._map.grid.cells.size),
            "memory, peak [MB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        }
        if telemetry is not None and telemetry.round_trip_ns is not None:
            figures["board, round trip [ms]"] = telemetry.round_trip_ns * 1e-6
        return figures


def _with_pictures(settings: SimulatorSettings, camera: bool) -> SimulatorSettings:
    """Return the settings with few pictures for the page, if wanted; the chair does not use them."""
    return replace(settings, camera=replace(settings.camera, rate_hz=_PICTURES_HZ if camera else 0.0))
