"""The demo of several chairs in one building, and its report: report.html and report.json."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.files import write_json
from waychair.geometry import transform_points
from waychair.maps.grid.cells import joined_to, occupied
from waychair.maps.traffic.corridors import NARROW, load_corridors
from waychair.offline.report import (
    COLOURS,
    Bars,
    PngFigure,
    Table,
    draw_map,
    draw_outline,
    new_figure,
    png_from_figure,
    write_page,
)
from waychair.planning.fleet.waits import jain
from waychair.trials.fleet.fleet_drive import FleetMoment, FleetRun, FleetScene, Keeper, drive_fleet
from waychair.trials.fleet.fleet_ordered import Stops
from waychair.trials.fleet.fleet_report import BestBay, bay_that_helps, corridor_sentence, waits_by_corridor
from waychair.trials.fleet.fleet_scenes import rooms_scene
from waychair.types import BoolArray, FloatArray, Json, OccupancyGrid, Pose2

WORLD = "T"
GOALS = 3
"""Goals of each chair."""

BAYS, BAY_HOURS = 3, 1.0
"""Corridors with the most waiting in which a bay is tried, and hours of drives on the traffic graph for each."""

REAL_TIME = 0.97
"""The chairs' seconds for each real one from which on that is told as real time."""

OUTLINE_EVERY_S = 10.0
"""s between two outlines of a chair in the report's picture."""


@dataclass(frozen=True, slots=True)
class FleetView:
    """What a page shows of all chairs at one moment, in plain values.

    Each chair has its outline's corners and stop line [m], its heading [rad], its goal, the number of goals reached, and its state in words.
    """

    seconds: float
    chairs: tuple[Json, ...]
    people: tuple[tuple[float, float], ...]


@dataclass(slots=True)
class FleetDemo:
    """The scene, its run, the wall time [s], and the bay that saves most in hours of such drives on the traffic graph.

    `first`: number of the first chair. `ended`: seconds and sentences about processes that ended on the way, and `factor`: the
    chairs' seconds for each real one, where every chair had a process of its own.
    """

    scene: FleetScene
    run: FleetRun
    wall_s: float
    bay: BestBay | None = None
    first: int = 0
    ended: Sequence[tuple[float, str]] = ()
    factor: float | None = None

    @property
    def waits_by_corridor(self) -> dict[str, float]:
        """The seconds that chairs waited for each corridor, the most first."""
        found: dict[str, float] = {}
        for wait in self.run.audit.ended:
            found[wait["place"]] = found.get(wait["place"], 0.0) + wait["real_s"]
        return waits_by_corridor(self.scene.graph, dict(sorted(found.items())))


class FleetWatcher:
    """Callbacks of a running demo; these do nothing."""

    def began(self, scene: FleetScene) -> None:
        """The chairs stand at their starts."""

    def moment(self, moment: FleetMoment) -> None:
        """A step of the order has passed."""


def demo_scene(world: str = WORLD, chairs: int = 3, seed: int = 0) -> FleetScene:
    """Return chairs with three goals each in the rooms of a floor plan, by name or path.

    Raises:
        TrafficError: there is no such plan, or it is impossible.
        TaskError: it has too few rooms.
        WorldError: its corridors reach beyond it.
    """
    return rooms_scene(load_corridors(world), chairs, GOALS, seed, width=NARROW)


def run_fleet_demo(
    scene: FleetScene,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    watcher: FleetWatcher | None = None,
    keeper: Keeper | None = None,
) -> FleetDemo:
    """Let the chairs of a scene drive to all their goals, and look where a bay would help; `keeper`: see `drive_fleet`.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    progress("prepare", 0.0)
    watcher = watcher or FleetWatcher()
    watcher.began(scene)
    progress("prepare", 1.0)
    total = sum(map(len, scene.goals))

    def on_moment(moment: FleetMoment) -> None:
        watcher.moment(moment)
        progress("drive", sum(moment.reached) / total)

    began = time.perf_counter()
    run = drive_fleet(scene, on_moment, keeper=keeper)
    progress("drive", 1.0)
    bay = best_bay(scene, progress)
    return FleetDemo(scene, run, time.perf_counter() - began, bay)


def best_bay(scene: FleetScene, progress: Callable[[str, float], None]) -> BestBay | None:
    """Return the bay that saves most in hours of such drives on the traffic graph."""
    progress("bays", 0.0)
    bay = bay_that_helps(
        scene.graph, chairs=len(scene.starts), hours=BAY_HOURS, seed=scene.seed, stops=Stops(), tries=BAYS
    )
    progress("bays", 1.0)
    return bay


def fleet_report(demo: FleetDemo) -> Json:
    """Return the demo's results as JSON; in lockstep the same seed gives the same bytes, so it holds no wall time."""
    run = demo.run
    waited = [chair.waited_s for chair in run.chairs]
    metres = [max(chair.metres, 1.0) for chair in run.chairs]
    done = sum(chair.reached for chair in run.chairs)
    processes: Json = {}
    if demo.factor is not None:
        ended = [{"s": round(at_s, 1), "what": what} for at_s, what in demo.ended]
        processes = {"real_time_factor": round(demo.factor, 3), "ended": ended}
    return {
        **({"processes": processes} if processes else {}),
        "world": demo.scene.graph.name,
        "seed": demo.scene.seed,
        "chairs": len(run.chairs),
        "goals": sum(chair.goals for chair in run.chairs),
        "goals_reached": done,
        "contacts": run.contacts,
        "chair_contacts": run.chair_contacts,
        "lockups": run.lockups,
        "delay_s": round(sum(waited) / done, 2) if done else None,
        "waits": len(run.audit.ended),
        "foreseen_right": run.audit.foreseen_right(),
        "jain": round(jain([a / b for a, b in zip(waited, metres, strict=True)]), 4),
        "nearest_chairs_m": round(run.nearest, 3) if np.isfinite(run.nearest) else None,
        "over_stop_line_m": round(max(chair.over_line for chair in run.chairs), 4),
        "seconds": round(run.seconds, 2),
        "waited_s_by_corridor": {name: round(seconds, 1) for name, seconds in demo.waits_by_corridor.items()},
        "bay": None if demo.bay is None else demo.bay.as_json(),
        "by_chair": [
            {
                "goals": list(goals),
                "reached": chair.reached,
                "took_s": [round(each, 2) for each in chair.took_s],
                "waited_s": round(chair.waited_s, 2),
                "metres": round(chair.metres, 2),
                "asked_again": chair.again,
                "ends": chair.ends,
            }
            for goals, chair in zip(demo.scene.goals, run.chairs, strict=True)
        ],
        "audit": run.audit.ended,
    }


def write_fleet_report(out: Path, demo: FleetDemo) -> None:
    """Write report.json and report.html.

    Raises:
        OutputError: the folder cannot be written.
    """
    values = fleet_report(demo)
    write_json(out / "report.json", values)
    rows = [
        (
            f"chair {demo.first + k}",
            ", ".join(chair["goals"]),
            f"{chair['reached']}",
            ", ".join(f"{each:.0f} s" for each in chair["took_s"]),
            f"{chair['waited_s']:.0f} s",
            f"{chair['metres']:.0f} m",
        )
        for k, chair in enumerate(values["by_chair"])
    ]
    audit = [
        (
            f"{each['begun_ms'] / 1e3:.0f} s",
            f"chair {each['waits']}",
            "" if each["first"] is None else f"chair {each['first']}",
            each["place"],
            each["rule"],
            "" if each["foreseen_s"] is None else f"{each['foreseen_s']:.0f} s",
            f"{each['real_s']:.0f} s",
        )
        for each in demo.run.audit.ended
    ]
    places = tuple((name, seconds, f"{seconds:.0f} s") for name, seconds in list(demo.waits_by_corridor.items())[:12])
    tables: list[Table | Bars] = [
        Table("Chairs", ("chair", "goals", "reached", "took", "waited for others", "driven"), tuple(rows)),
        Bars("Waiting for each corridor", places),
        Table("Every wait", ("at", "waits", "first", "place", "rule", "foreseen", "real"), tuple(audit)),
    ]
    if demo.factor is not None:
        rows_of_ended = tuple((f"{at_s:.0f} s", what) for at_s, what in demo.ended)
        tables.append(Table("Processes that ended, and were started again", ("at", "what"), rows_of_ended))
    pace = "" if demo.factor is None else f" {pace_sentence(demo.factor)}"
    lead = (
        f"{values['goals_reached']} of {values['goals']} goals reached by {values['chairs']} chairs on "
        f"{values['world']} in {values['seconds']:.0f} s of their time; {values['contacts']} contacts, "
        f"{values['lockups']} lock-ups, seed {values['seed']}.{pace} {where_it_waits(demo)}"
    )
    write_page(out / "report.html", f"waychair fleet: {values['world']}", lead, tables, [_tracks_picture(demo)])


def pace_sentence(factor: float) -> str:
    """Return how fast the chairs' time passed beside real time."""
    if factor > REAL_TIME:
        return "Every chair had a process of its own, in real time."
    return f"Every chair had a process of its own; their time passed {factor:.2f} times as fast as real time."


def where_it_waits(demo: FleetDemo) -> str:
    """Return which corridor cost most waiting, and where one bay would save most."""
    graph = demo.scene.graph
    costly = corridor_sentence(graph, demo.waits_by_corridor, demo.run.seconds / 3600.0)
    bay = f"no bay in its corridors saves anything in {BAY_HOURS:g} h of such drives"
    bay = bay if demo.bay is None else f"{demo.bay.sentence} in {BAY_HOURS:g} h of such drives"
    return f"{costly or 'No chair waited for another one'}. {bay[0].upper()}{bay[1:]}."


def _tracks_picture(demo: FleetDemo) -> PngFigure:
    figure, axes = new_figure(9, 9)
    draw_map(axes, demo.scene.world.grid)
    for k, chair in enumerate(demo.run.chairs):
        colour = COLOURS[k % len(COLOURS)]
        track = np.array(chair.track).reshape(-1, 4)
        axes.plot(track[:, 1], track[:, 2], color=colour, linewidth=1.4, label=f"chair {demo.first + k}")
        step = max(round(OUTLINE_EVERY_S / 0.1), 1)
        for _, x, y, theta in track[::step].tolist():
            draw_outline(axes, demo.scene.body.outline(), Pose2(x, y, theta), colour)
    axes.legend(loc="upper right")
    return PngFigure("The ways of the chairs", f"an outline every {OUTLINE_EVERY_S:.0f} s", png_from_figure(figure))


def plan_of(scene: FleetScene) -> Json:
    """Return the plan that a page shows: its corner and size, floor and walls as strips, and places.

    A strip is x, y, length, width [m].
    """
    grid = scene.world.grid
    rows, columns = grid.cells.shape
    side, x0, y0 = grid.resolution, grid.map_from_grid.x, grid.map_from_grid.y
    start = scene.places[scene.starts[0]].pose
    places = [[name, round(place.pose.x, 2), round(place.pose.y, 2)] for name, place in scene.places.items()]
    return {
        "corner": [x0, y0],
        "size": [columns * side, rows * side],
        "floor": _strips(grid, joined_to(grid, start.x, start.y)),
        "walls": _strips(grid, occupied(grid)),
        "places": places,
    }


def _strips(grid: OccupancyGrid, mask: BoolArray) -> list[list[float]]:
    """Return the cells of a mask as strips along x; equal ones of rows one above the other are one."""
    side, x0, y0 = grid.resolution, grid.map_from_grid.x, grid.map_from_grid.y
    open_strips: dict[
        tuple[int, int], int
    ] = {}  # columns of the strips in the row below, and the row where each begins
    found: list[list[float]] = []
    for row, cells in enumerate([*mask, np.zeros(mask.shape[1], np.bool_)]):
        changes = np.flatnonzero(np.diff(np.concatenate([[False], cells, [False]]).astype(np.int8)))
        here = [(begin, end) for begin, end in changes.reshape(-1, 2).tolist()]
        for (begin, end), first in open_strips.items():
            if (begin, end) not in here:
                strip = (x0 + begin * side, y0 + first * side, (end - begin) * side, (row - first) * side)
                found.append([round(each, 3) for each in strip])
        open_strips = {strip: open_strips.get(strip, row) for strip in here}
    return found


def view_of(scene: FleetScene, moment: FleetMoment) -> FleetView:
    """Return what a page shows of a moment."""
    sentences = {wait.chair: wait.sentence for wait in moment.waits}
    chairs = []
    for k, (pose, state) in enumerate(zip(moment.poses, moment.states, strict=True)):
        told = sentences.get(k) or state.navigation.reason or state.navigation.stage.value
        chairs.append(chair_view(scene, k, k, pose, moment.reached[k], moment.lines[k], told))
    people: Sequence[Sequence[float]] = moment.people.tolist()
    return FleetView(
        seconds=round(moment.now_ns * 1e-9, 1),
        chairs=tuple(chairs),
        people=tuple((x, y) for x, y in people),
    )


def chair_view(
    scene: FleetScene, index: int, number: int, pose: Pose2, reached: int, line: FloatArray | None, told: str
) -> Json:
    """Return what a page shows of a chair; `index` is its place in the scene."""
    goals = scene.goals[index]
    return {
        "number": number,
        "corners": _corners(scene.body, pose),
        "heading": round(pose.theta, 3),
        "goal": goals[reached] if reached < len(goals) else "",
        "told": told,
        "reached": reached,
        "goals": len(goals),
        "line": None if line is None else np.round(line, 3).tolist(),
    }


def _corners(body: ChairBody, pose: Pose2) -> list[list[float]]:
    corners: list[list[float]] = np.round(transform_points(pose, body.outline()), 3).tolist()
    return corners
