"""The live chair of a page, in real time over the shipped firmware: requests, answers and failures.

Times are simulated, so that a busy computer has no effect.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import WaychairError
from waychair.firmware_bridge.protocol import Holder
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.drawn.zones import Rule, Zone, load_zones
from waychair.maps.folders.map_files import save_map
from waychair.runtime.pages.chair_port import ChairPort, ChairView
from waychair.simulation.plan.world import World, world_from_grid
from waychair.slam.localising.localisation import LocalisationState
from waychair.trials.live.live_chair import LiveChair
from waychair.types import DriveMode, JoystickInput, OccupancyGrid, Place, Pose2

PATIENCE_S = 60.0
NEAR = Place("near", Pose2(3.2, 2.5, 0.0))
FAR = Place("far", Pose2(8.0, 2.5, 0.0))


def hall() -> World:
    cells = np.full((100, 200), 100, np.int8)
    cells[2:98, 2:198] = 0
    cells[2:6, 60:80] = cells[94:98, 120:150] = 100
    return world_from_grid(OccupancyGrid(cells, 0.05), Pose2(1.5, 2.5, 0.0), name="hall")


@contextmanager
def live(folder: Path, countdown_s: float = 0.0, **options: bool) -> Iterator[LiveChair]:
    """Yield a chair in the hall, with the chair's start as the origin of its map."""
    world = hall()
    to_map = world.start.inverse()
    save_map(folder, OccupancyGrid(world.grid.cells, world.grid.resolution, to_map))
    save_places(folder, {place.name: Place(place.name, to_map @ place.pose) for place in (NEAR, FAR)})
    with LiveChair(world, folder, countdown_s=countdown_s, urgently=True, **options) as chair:
        until(chair, lambda view: view.localisation is LocalisationState.OK and not view.obstacles)
        yield chair


def until(chair: LiveChair, true: Callable[[ChairView], bool], pages: tuple[str, ...] = ("page",)) -> ChairView:
    """Return the first view that satisfies a condition, while these pages are open."""
    ends = time.monotonic() + PATIENCE_S
    while not true(chair.view()):
        assert time.monotonic() < ends, chair.view()
        assert chair.alive, chair.view().last_stop
        chair.watched(pages)
        time.sleep(0.02)
    return chair.view()


def sets_off(chair: LiveChair, place: str = "far") -> None:
    assert chair.go(place).done
    begun = chair.confirm(place)
    assert begun.done, begun.sentence
    until(chair, lambda view: view.twist.v > 0.2)


def stands(view: ChairView) -> bool:
    return abs(view.twist.v) < 0.01 and abs(view.twist.omega) < 0.01


def test_it_is_a_chair_port(tmp_path: Path) -> None:
    chair: ChairPort = LiveChair(hall(), tmp_path)
    assert chair.outline.shape[1] == 2


def test_the_chair_drives_to_a_place_after_a_confirmation(tmp_path: Path) -> None:
    with live(tmp_path, countdown_s=1.0) as chair:
        assert not chair.confirm().done
        assert "did you mean" in chair.go("neer").sentence
        assert chair.go("near").done
        asked = until(chair, lambda view: len(view.path) > 1)
        assert (asked.waits, asked.goal, asked.mode) == (True, "near", DriveMode.MANUAL)
        assert chair.go("far").done
        assert "far" in chair.confirm("near").sentence  # the goal was changed meanwhile
        assert chair.go("near").done
        assert chair.confirm("near").done
        counted = until(chair, lambda view: view.countdown_s is not None)
        assert stands(counted)
        driven = until(chair, lambda view: view.twist.v > 0.1)
        assert "to near" in driven.next_action
        assert driven.free_since_ns is None
        assert len(driven.scan) > 50
        over = until(chair, lambda view: not view.goal)
        assert over.last_stop == "Arrived at near."
        assert chair.simulator.contacts == 0
        assert over.map_from_base is not None
        assert np.hypot(over.map_from_base.x - 1.7, over.map_from_base.y) < 0.15


@pytest.mark.nightly
def test_a_drive_pauses_and_continues(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        assert chair.pause().sentence == "there is no drive to pause"
        sets_off(chair)
        assert chair.pause().done
        rested = until(chair, stands)
        assert rested.paused
        assert rested.goal == "far"
        assert rested.next_action == "Paused on the way to far. Press Go on, or end the drive."
        assert chair.go_on().done
        on = until(chair, lambda view: view.twist.v > 0.2)
        assert not on.paused
        assert chair.go_on().sentence == "no drive is paused: ask for a goal"
        assert chair.cancel().done


def test_stop_is_on_the_lines_within_a_tenth_of_a_second(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        sets_off(chair)
        before_ns = chair.simulator.now_ns
        assert chair.stop().done
        while chair.simulator.lines is None or chair.simulator.lines.holder == Holder.BOARD:
            assert chair.simulator.now_ns - before_ns < 100_000_000
        assert chair.view().mode is DriveMode.STOPPED
        rested = until(chair, stands)
        assert rested.last_stop.startswith("Stop was pressed")
        assert rested.free_since_ns is not None
        assert not chair.confirm().done


@pytest.mark.nightly
def test_a_drive_continues_through_a_reload_and_ends_with_the_last_page(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        sets_off(chair)
        chair.watched([])
        chair.watched(["another"])
        assert chair.view().mode is DriveMode.AUTONOMOUS
        ended = until(chair, lambda view: view.mode is not DriveMode.AUTONOMOUS, pages=())
        assert ended.last_stop.startswith("No page with a Stop button answers any more")
        until(chair, stands)


@pytest.mark.nightly
def test_a_drive_ends_when_the_calls_cease(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        sets_off(chair)
        ends = time.monotonic() + PATIENCE_S
        while chair.view().mode is DriveMode.AUTONOMOUS:
            assert time.monotonic() < ends
            time.sleep(0.05)
        assert chair.view().last_stop.startswith("No page with a Stop button answers any more")


def test_drawings_are_saved_and_in_force_and_can_be_undone(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        first = chair.view()
        assert chair.place_here(" desk ", 0.05, 0.03).done
        assert chair.go("desk").done
        wall = np.array([[1.2, -2.0], [1.6, -2.0], [1.6, 2.0], [1.2, 2.0]])
        assert chair.set_zone(Zone("wet", Rule.KEEP_OUT, wall)).done
        assert chair.set_zone(Zone("dry", Rule.SLOW, wall + 3.0, 0.2)).done
        assert chair.remove_zone("dry").done
        assert "stands in this zone" in chair.set_zone(Zone("here", Rule.KEEP_OUT, wall - [1.4, 0.0])).sentence
        assert "wall" in chair.set_place(Place("solid", Pose2(-1.45, 0.0))).sentence
        assert {*load_places(tmp_path)} == {"near", "far", "desk"}
        assert load_zones(tmp_path)[0].name == "wet"
        drawn = until(chair, lambda view: view.layout_revision >= first.layout_revision + 2)
        assert drawn.map_revision == first.map_revision
        grid = chair.grid()
        assert chair.erase(np.array([[-2.0, -2.6], [9.0, -2.6], [9.0, -2.1], [-2.0, -2.1]])).done
        erased = chair.grid()
        assert grid is not None
        assert erased is not None
        assert (grid.cells == 100).sum() > (erased.cells == 100).sum()
        until(chair, lambda view: view.map_revision == first.map_revision + 1)
        until(chair, lambda view: view.health < drawn.health - 0.05)  # the localiser uses the changed map
        for left in (True, True, True, True, False):
            assert chair.layout().undoable
            assert chair.undo().done
            assert chair.layout().undoable == left
        assert not chair.undo().done
        assert {*chair.layout().places} == {"near", "far"}
        assert chair.layout().zones == ()
        again = chair.grid()
        assert again is not None
        assert np.array_equal(again.cells, grid.cells)


@pytest.mark.nightly
def test_a_page_steers_and_the_riders_own_joystick_has_priority(tmp_path: Path) -> None:
    with live(tmp_path) as chair:
        held = threading.Event()

        def hold() -> None:
            while not held.wait(0.1):
                chair.steer(1.0, 0.0)

        hand = threading.Thread(target=hold)
        hand.start()
        try:
            moved = until(chair, lambda view: view.twist.v > 0.2)
            assert (moved.steered, moved.mode) == (True, DriveMode.ASSISTED)
            chair.simulator.rider = JoystickInput(0, 0.0, 0.4)
            until(chair, lambda view: view.mode is DriveMode.MANUAL)
            chair.simulator.rider = JoystickInput(0)
            time.sleep(0.5)
            assert chair.view().mode is DriveMode.MANUAL
        finally:
            held.set()
            hand.join()
        assert "by joystick" in chair.view().last_stop


def test_a_failure_in_the_chairs_thread_releases_the_lines_and_is_reported(tmp_path: Path) -> None:
    class Broken(Exception):
        pass

    def breaks() -> None:
        raise Broken("a wheel came off")

    def until_it_breaks() -> None:
        with live(tmp_path) as chair:
            sets_off(chair)
            chair._loop.tell(breaks)
            ends = time.monotonic() + PATIENCE_S
            while chair.alive:
                assert time.monotonic() < ends
                time.sleep(0.02)
            lines, view = chair.simulator.lines, chair.view()
            assert lines is not None
            assert lines.holder == Holder.JOYSTICK
            assert view.mode is DriveMode.STOPPED
            assert view.last_stop == "The simulated chair has failed: a wheel came off."
            assert "start it again" in chair.stop().sentence

    with pytest.raises(Broken):
        until_it_breaks()


def test_an_unreadable_map_is_reported_before_anything_starts(tmp_path: Path) -> None:
    with pytest.raises(WaychairError, match="there is no map"), LiveChair(hall(), tmp_path / "nowhere"):
        pass


def test_a_world_without_a_map_does_not_keep_drawings(tmp_path: Path) -> None:
    with LiveChair(hall(), urgently=True) as chair:
        assert chair.place_here("desk", 0.1, 0.1).done or chair.view().map_from_base is None
        folder = chair._map.folder
    assert not folder.exists()
