"""The demo on a web page, live: visitors can watch it and stop it for good."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.drawn.zones import Zone
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.pages.chair_display import ChairDisplay
from waychair.runtime.pages.chair_port import ChairView, GoalView, LayoutView, PortAnswer
from waychair.runtime.pages.chair_story import shown_points
from waychair.runtime.pages.guard_port import WithoutLevels
from waychair.runtime.pages.haptic_port import WithoutHaptics
from waychair.runtime.pages.perception_view import WithoutCells
from waychair.slam.localising.localisation import LocalisationState
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.trials.demo.demo import DemoWatcher
from waychair.trials.drive import DriveSetup
from waychair.types import DriveMode, FloatArray, OccupancyGrid, Place, Pose2, Scan, SensorMessage, Twist

_VIEWS_S, _GRIDS_S = 0.05, 1.0
_NOT_HERE = PortAnswer(False, "the demo drives by itself: use `waychair page` to drive a simulated chair")
_MAPPING = "A rider drives by joystick while the chair makes the map."
_FINDING = "A rider drives by joystick until the chair has found its place on the map."
_BEFORE_START = ChairView(
    stamp_ns=0,
    map_from_base=None,
    localisation=LocalisationState.LOST,
    health=0.0,
    mode=DriveMode.MANUAL,
    twist=Twist(),
    next_action="The demo is starting.",
)


class DemoPage(DemoWatcher, WithoutCells, WithoutHaptics, WithoutLevels):
    """A `ChairPort` of the demo's chair; the demo's thread updates the views between its ticks.

    `views_s` and `grids_s` [s, wall time] are the periods of the views and of the drawings of the map.
    """

    def __init__(self, views_s: float = _VIEWS_S, grids_s: float = _GRIDS_S) -> None:
        self._between_views_s, self._between_grids_s = views_s, grids_s
        self._view = _BEFORE_START
        self._grid: OccupancyGrid | None = None
        self._layout = LayoutView()
        self._revision = 0
        self._chair: Chair | None = None  # while a rider makes the map
        self._display: ChairDisplay
        self._stop = threading.Event()
        self._viewed_s = self._drawn_s = 0.0

    # --- callbacks of the demo ------------------------------------------------------------------------------------

    def scan_mapped(self, live: LiveMapping, scan: Scan) -> None:
        """See `DemoWatcher`."""
        if not self._due():
            return
        now_s, pose = time.monotonic(), live.pose()
        if now_s - self._drawn_s >= self._between_grids_s:
            self._drawn_s = now_s
            self._show(live.grid(), LayoutView())
        self._view = replace(
            _BEFORE_START,
            map_from_base=pose,
            localisation=LocalisationState.OK,
            health=1.0,
            next_action=_MAPPING,
            scan=shown_points(scan, live.base_from_laser, pose, Twist()),
            map_revision=self._revision,
            layout_revision=self._revision,
        )

    def drive_began(self, setup: DriveSetup, chair: Chair) -> None:
        """See `DemoWatcher`."""
        self._chair = chair
        self._display = ChairDisplay(chair, CHAIR_A.base_from_laser)
        self._show(setup.grid, LayoutView(dict(setup.places), tuple(setup.zones)))

    def goal_chosen(self, goal: str) -> None:
        """See `DemoWatcher`."""
        self._display.label = goal

    def tick_ended(self, messages: Sequence[SensorMessage], state: ChairState) -> None:
        """See `DemoWatcher`."""
        self._display.hear(messages, state)
        assert self._chair is not None
        if self._stop.is_set() and (self._chair.waits or self._chair.navigator.active):
            self._chair.stop()
        if self._due():
            view = self._display.view(state)
            told = view.next_action if self._display.label else _FINDING
            self._view = replace(view, next_action=told, map_revision=self._revision, layout_revision=self._revision)

    @property
    def stop_requested(self) -> bool:
        """See `DemoWatcher`."""
        return self._stop.is_set()

    def _due(self) -> bool:
        now_s = time.monotonic()
        if now_s - self._viewed_s < self._between_views_s:
            return False
        self._viewed_s = now_s
        return True

    def _show(self, grid: OccupancyGrid, layout: LayoutView) -> None:
        self._grid, self._layout = grid, layout
        self._revision += 1

    # --- requests of pages ----------------------------------------------------------------------------------------

    @property
    def outline(self) -> FloatArray:
        """See `ChairPort`."""
        return CHAIR_A.outline()

    def view(self) -> ChairView:
        """See `ChairPort`; stamped now: during long computations simulated time stands still, and nothing is stale."""
        return replace(self._view, stamp_ns=time.monotonic_ns())

    def grid(self) -> OccupancyGrid | None:
        """See `ChairPort`."""
        return self._grid

    def goals(self) -> tuple[GoalView, ...]:
        """See `ChairPort`; the demo has no building."""
        return ()

    def layout(self) -> LayoutView:
        """See `ChairPort`."""
        return self._layout

    def picture(self) -> bytes | None:
        """See `ChairPort`; there is none."""
        return None

    def stop(self) -> PortAnswer:
        """See `ChairPort`: the computer stops driving from the next tick on; the rider's joystick stays live."""
        self._stop.set()
        now = "stopped" if self._chair is not None else "a rider drives now"
        return PortAnswer(True, f"{now}: the computer will not drive in this demo any more")

    def pause(self) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def go_on(self) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def cancel(self) -> PortAnswer:
        """See `ChairPort`; the same as stop here."""
        return self.stop()

    def answer_storey(self, storey: str) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def start_at(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def guide(self, goal: str, level: int) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def end_guide(self) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def go(self, goal: str | Pose2) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def confirm(self, goal: str = "") -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def reset(self) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def steer(self, forward: float, turn: float) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def release(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(True, "")

    def place_here(self, name: str, tolerance_m: float, tolerance_rad: float, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def set_place(self, place: Place, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def rename_place(self, name: str, new_name: str) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def remove_place(self, name: str) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def set_zone(self, zone: Zone, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def remove_zone(self, name: str) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def erase(self, polygon: FloatArray) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def undo(self) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def relocalise(self, map_from_base: Pose2 | None = None) -> PortAnswer:
        """See `ChairPort`."""
        return _NOT_HERE

    def watched(self, pages: Sequence[str]) -> None:
        """See `ChairPort`: does nothing, as a demo goes on without a page."""
