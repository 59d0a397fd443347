"""The editor of buildings: a newcomer's script by keyboard, faults shown and gone, saves cut off, bytes kept, frames a second.

The page runs in Chromium on the real server; the building is that of the world `two_floors`, made from its maps.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluation.scenes.buildings.building_faults import FAULTS
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.hgraph import (
    Arc,
    GraphDoorway,
    HGraph,
    Node,
    NodeKind,
    Storey,
    SubMap,
    SubmapFrame,
)
from waychair.maps.building.indexed import indexed
from waychair.maps.drawn.places import save_places
from waychair.maps.editing.draft import Draft, draft_of, save_draft, texts_of_draft, zoned
from waychair.maps.editing.edit_log import LOG
from waychair.maps.editing.operations import applied, operation_of
from waychair.maps.exchange.exchange import SCALE, read_exchange
from waychair.maps.exchange.flat_graph import write_imported
from waychair.maps.folders.map_files import save_map
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.simulation.plan.world import load_levels
from waychair.trials.travel.building_drive import drive_in_building
from waychair.trials.travel.world_building import building_of_world
from waychair.types import Json
from waychair.ui.editor.server import editor_server
from waychair.ui.editor.session import LOCK, Session

if TYPE_CHECKING:
    from playwright.sync_api import Page

KILLS = int(os.environ.get("EDITOR_KILLS", "200"))
MOST_PRESSES, MOST_MS, LEAST_FPS = 250, 200.0, 30.0
NODES = 5000
LIMIT_MS = 120_000

_FARTHEST = 100
"""Presses of Tab after which an element cannot be reached."""

WORLD = "two_floors"

_WAIT = """async ([edits, code, place, there]) => {
  const { edit, post } = await import('/static/js/building/model.js');
  const run = (op) => (typeof op === 'string' ? post(op).then(({ done }) => done) : edit(op));
  const shown = () => [...document.querySelectorAll('#faults-list [data-ref]')].some(
    (each) => each.dataset.ref === `${code} ${place}`);
  for (const op of edits.slice(0, -1)) if (!(await run(op))) return -1;
  const begun = performance.now();
  if (!(await run(edits.at(-1)))) return -2;
  for (let k = 0; shown() !== there; k += 1) {
    if (k > 200) return -3;
    await new Promise((done) => setTimeout(done, 10));
  }
  return performance.now() - begun;
}"""

_PAN = """async (seconds) => {
  const { pan, fit } = await import('/static/js/building/canvas.js');
  fit();
  const times = [];
  const begun = performance.now();
  while (performance.now() - begun < 1000 * seconds) {
    pan(Math.sin(times.length / 20) > 0 ? 4 : -4, 1);
    times.push(await new Promise((done) => requestAnimationFrame(done)));
  }
  return times;
}"""


class Keys:
    """A keyboard that counts its presses; each letter typed is one."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.count = 0

    def press(self, *keys: str) -> None:
        """Press keys one after the other; `3 Tab` presses Tab three times."""
        for key in keys:
            times, _, name = key.partition(" ") if key[:1].isdigit() and " " in key else ("1", "", key)
            for _ in range(int(times)):
                self.page.keyboard.press(name)
                self.count += 1

    def type(self, text: str) -> None:
        """Type a text in place of what is in the field."""
        self.press("Control+a")
        self.page.keyboard.type(text)
        self.count += len(text)

    def go_to(self, selector: str, key: str = "Tab") -> None:
        """Press Tab or Shift+Tab until an element has the focus."""
        for _ in range(_FARTHEST):
            if self.page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
                return
            self.press(key)
        raise RuntimeError(f"the keyboard does not reach {selector}")

    def hear(self, text: str) -> None:
        """Wait until the page says something with this text."""
        self.page.wait_for_function("(text) => document.querySelector('#said').textContent.includes(text)", arg=text)


@contextmanager
def page_of(session: Session, **context: Any) -> Iterator[Page]:
    """The editor's page for a session."""
    from playwright.sync_api import sync_playwright

    program = os.environ.get("WAYCHAIR_CHROMIUM") or shutil.which("chromium")
    with (
        editor_server(session) as address,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=program) as browser,
    ):
        page = browser.new_page(**{"viewport": {"width": 1280, "height": 900}, **context})
        page.set_default_timeout(LIMIT_MS)
        page.goto(address)
        page.wait_for_function("() => document.querySelector('#state').textContent !== 'Loading'")
        yield page


def maps_of_world(folder: Path) -> None:
    """Write the maps of the world's levels with their places, as folders beside the building to be made."""
    for level in load_levels(WORLD):
        save_map(folder / "maps" / level.level, level.grid)
        save_places(folder / "maps" / level.level, {place.name: place for place in level.places})


def newcomer(page: Page) -> int:
    """Make the building from its maps by keyboard only, correct it and save it; return the number of key presses."""
    keys = Keys(page)
    page.wait_for_function("() => document.activeElement.dataset.field === 'map'")
    keys.press("5 Tab", "Enter")  # the first map, with the proposed name
    keys.hear("new places")
    page.wait_for_function("() => document.querySelector('[data-form=storey] [data-field=id]').value === 'upper'")
    keys.press("Enter")
    page.wait_for_selector("[data-form=lift]")
    page.wait_for_function("() => document.querySelector('#undo').title.includes(\"the graph of 'upper'\")")
    keys.press("6 Shift+Tab", "Enter")  # the lift, with the proposed stops
    keys.hear("stops on 2 storeys")

    keys.press("5 Shift+Tab", "3 ArrowRight", "Tab")  # the parts: find the lift's own shaft, which is no room
    for storey in ("ground", "upper"):
        keys.type(f"{storey}/r3")
        keys.press("Enter")
        page.wait_for_function(
            "(path) => document.querySelector('#parts [data-ref]')?.dataset.ref.endsWith(path)", arg=f"{storey}/r3"
        )
        keys.press("2 Tab", "Enter")
        page.wait_for_function("() => document.activeElement.closest('[data-form]')?.dataset.form === 'this submap'")
        keys.press("6 Tab", "Enter")  # delete
        keys.hear("Deleted")
        if storey == "ground":
            keys.press("Shift+Tab", "ArrowRight", "Tab")
    return keys.count + _correct(page)


def _correct(page: Page) -> int:
    """Add a goal that is joined to nothing, do what the checks say, and save; return the number of key presses."""
    keys = Keys(page)
    keys.go_to("#storey", "Shift+Tab")
    keys.press("ArrowUp")
    keys.go_to("#canvas")
    keys.press("2 ArrowDown", "n")
    keys.hear("Added ")
    keys.press("Control+s")
    keys.hear("Kept as a draft")
    page.wait_for_selector("#faults:not([hidden]) .error")
    keys.go_to("#tab-faults")
    keys.press("Tab", "Enter")
    page.wait_for_selector("[data-form='this node']")
    keys.go_to("[data-button='Join these']")
    keys.press("Enter")
    page.wait_for_function("() => document.querySelector('#state').textContent.includes(' 0 errors')")
    keys.press("Control+s")
    keys.hear("Saved")
    return keys.count


def _arrives(folder: Path) -> tuple[bool, str]:
    """Let a simulated chair drive from the entrance to the office on the other storey."""
    building = load_building(folder)
    hgraph = zoned(draft_of(building))
    planner = RoutePlanner(hgraph, Method.ASTAR, built=indexed(hgraph, time.time_ns()))
    record = drive_in_building(building, planner, planner.node("entrance"), planner.node("office"))
    return record.arrived and not record.contacts, record.why


def _fault_times(page: Page) -> list[Json]:
    """Return for each fault the times [ms] from its last edit until it is shown, and from its remedy until it is gone."""
    rows = []
    for fault in FAULTS:
        place = fault.place
        shown = page.evaluate(_WAIT, [list(fault.edits), fault.code, place, True])
        gone = page.evaluate(_WAIT, [list(fault.remedy), fault.code, place, False])
        rows.append({"code": fault.code, "shown_ms": round(shown, 1), "gone_ms": round(gone, 1)})
        page.evaluate(
            """async (steps) => {
              const { post } = await import('/static/js/building/model.js');
              for (let k = 0; k < steps; k += 1) await post('undo');
            }""",
            len(fault.edits) + len(fault.remedy),
        )
    arc = FAULTS[-1].edits[0]["arc"]
    edits, place = ["tables", {"do": "change_arc", "arc": arc, "speed": 0.5}], WORLD
    shown = page.evaluate(_WAIT, [edits, "E15", place, True])
    gone = page.evaluate(_WAIT, [["save"], "E15", place, False])
    rows.append({"code": "E15", "shown_ms": round(shown, 1), "gone_ms": round(gone, 1)})
    return rows


def _missing_map_s(page: Page, folder: Path) -> float:
    """Return the seconds until the page shows that a storey's map has gone (E16), looked for once a second."""
    map_folder, aside = folder / "maps" / "upper", folder / "aside"
    begun = time.monotonic()
    map_folder.rename(aside)
    page.wait_for_selector("#faults-list [data-ref='E16 storey upper']", state="attached")
    took = time.monotonic() - begun
    aside.rename(map_folder)
    page.wait_for_selector("#faults-list [data-ref='E16 storey upper']", state="detached")
    return took


def _frames(folder: Path) -> float:
    """Return the mean frames a second [1/s] while a building of `NODES` nodes is panned for three seconds."""
    with Session(large_building(folder).folder) as session, page_of(session) as page:
        page.wait_for_timeout(1000)
        times = np.array(page.evaluate(_PAN, 3.0))
    return float(1000.0 * (len(times) - 1) / (times[-1] - times[0]))


def large_building(folder: Path) -> Building:
    """Write a storey of 500 rooms along 10 corridors, 5,000 nodes in all, and return the building."""
    rooms, per_room = 500, 9
    submaps = {"": SubMap("")}
    corridor: dict[str, Node] = {}
    arcs, doors = [], []
    for room in range(rooms):
        row, column = divmod(room, 50)
        x, y, id_ = 4.0 * column, 9.0 * row, f"r{room}"
        corridor[f"c{room}"] = Node(f"c{room}", NodeKind.CROSS, x, y)
        if column:
            arcs.append(Arc(f"c{room - 1}", f"c{room}"))
        elif row:
            arcs.append(Arc(f"c{room - 50}", f"c{room}"))
        doors.append(GraphDoorway(f"c{room}", id_, "d"))
        nodes = [Node("d", NodeKind.BRIDGE, 0.0, 0.0)]
        nodes += [Node(f"n{k}", NodeKind.CROSS, (k % 3) - 1.0, 2.0 + k // 3) for k in range(per_room - 2)]
        nodes.append(Node("e", NodeKind.END, 0.0, 6.0, f"Room {room}"))
        inner = tuple(Arc(one.id, other.id) for one, other in pairwise(nodes))
        submaps[f"g/{id_}"] = SubMap(
            f"g/{id_}", f"Room {room}", SubmapFrame(x, y), nodes={each.id: each for each in nodes}, arcs=inner
        )
    submaps["g"] = SubMap("g", "Ground", storey="g", nodes=corridor, arcs=tuple(arcs), doorways=tuple(doors))
    order = {path: submaps[path] for path in ("", "g", *(each for each in submaps if each.startswith("g/")))}
    building = Building(folder, HGraph("Large", (Storey("g", "Ground"),), order))
    save_building(building)
    return building


def _cut_off(folder: Path, kills: int) -> tuple[int, int]:
    """Kill a program while it saves, `kills` times; return how often the building was the old or the new one, and cut-off saves.

    Each save changes the files of two storeys, the places and the general file.
    """
    edits: list[Json] = [
        {"do": "move_nodes", "nodes": ["ground/r1:p1", "upper/r1:p1"], "x": 0.05, "y": 0.0},
        {"do": "change_building", "name": "Two floors"},
        {"do": "change_storey", "id": "upper", "name": "Above", "height": 3.6},
    ]
    whole, cut, rng = 0, 0, random.Random(7)
    usual = 0.0
    for _ in range(kills):
        before = draft_of(load_building(folder))
        after = before
        for asked in edits:
            after = applied(after, operation_of(_other_way(asked, before)))
        if not usual:
            begun = time.perf_counter()
            save_draft(folder, after, before)
            usual = time.perf_counter() - begun
            save_draft(folder, before, after)
        child = os.fork()
        if not child:
            try:
                save_draft(folder, after, before)
            finally:
                os._exit(0)
        time.sleep(rng.uniform(0.0, 1.2 * usual))
        os.kill(child, signal.SIGKILL)
        cut += os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0
        now = texts_of_draft(draft_of(load_building(folder)))
        whole += now in (texts_of_draft(before), texts_of_draft(after))
    return whole, cut


def _other_way(asked: Json, draft: Draft) -> Json:
    """Return the edit that goes back if the last save held it, so that each save changes something."""
    is_moved = draft.hgraph.name == "Two floors"
    if asked["do"] == "move_nodes":
        return {**asked, "x": -asked["x"] if is_moved else asked["x"]}
    return {**asked, "name": f"{asked['name']} again"} if is_moved else asked


def _same_bytes(folder: Path) -> Mapping[str, bool]:
    """Open and save each building of the shared data without a change; return whether its files keep their bytes."""
    data = Path(os.environ.get("WAYCHAIR_DATA", ""))
    found = {}
    for source in _shared_buildings(data):
        target = folder / source.name.replace(".", "-")
        write_imported(target, read_exchange(source, "", None, SCALE))
        before = _files(target)
        with Session(target) as session:
            session.save(session.revision)
            save_draft(target, session.draft, session.draft)  # as well where errors keep it a draft
        found[source.name] = _files(target) == before
    return found


def _shared_buildings(data: Path) -> Iterator[Path]:
    yield from sorted(data.glob("rmf_buildings/*.building.yaml"))
    yield from sorted(data.glob("nav2_route_graphs/*_graph.geojson"))
    if (data / "graph_bwh").is_dir():
        yield data / "graph_bwh"


def _files(folder: Path) -> dict[str, bytes]:
    return {
        each.relative_to(folder).as_posix(): each.read_bytes()
        for each in sorted(folder.rglob("*"))
        if each.is_file() and each.name not in (LOG, LOCK)
    }


def editor(out: Path) -> Json:
    """Key presses of a newcomer, times of faults [ms], saves cut off, bytes kept, frames a second."""
    with tempfile.TemporaryDirectory(prefix="waychair-") as name:
        site = Path(name)
        maps_of_world(site)
        with Session(site / "clinic") as session, page_of(session) as page:
            presses = newcomer(page)
        arrived, why = _arrives(site / "clinic")
        building_of_world(load_levels(WORLD), site / "known", CHAIR_A)
        with Session(site / "known") as session, page_of(session) as page:
            faults = _fault_times(page)
            missing = _missing_map_s(page, site / "known")
        whole, cut = _cut_off(site / "known", KILLS)
        same = _same_bytes(site / "shared")
        frames = _frames(site / "large")
    shown, gone = ([row[key] for row in faults] for key in ("shown_ms", "gone_ms"))
    return {
        "passed": presses <= MOST_PRESSES
        and arrived
        and min(shown + gone) >= 0.0
        and max(shown) <= MOST_MS
        and whole == KILLS
        and all(same.values())
        and frames >= LEAST_FPS,
        "key_presses": presses,
        "arrived": arrived,
        "why": why,
        "shown_ms_max": max(shown),
        "gone_ms_max": max(gone),
        "faults": faults,
        "missing_map_s": round(missing, 1),
        "kills": KILLS,
        "cut_off": cut,
        "old_or_new": whole,
        "same_bytes": same,
        "nodes": NODES,
        "frames_per_s": round(frames, 1),
    }
