"""Buildings with one fault each, in text files and map folders of their own: `waychair building check` names it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import waychair
from tests.maps.building.buildings import two_storeys
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.building.hgraph import HGraph
from waychair.maps.drawn.places import save_places
from waychair.maps.drawn.zones import Rule, Zone, save_zones
from waychair.maps.folders.map_files import save_map
from waychair.types import OccupancyGrid, Place, Pose2

Damage = Callable[[Path], object]


def replaced(file: str, old: str, new: str) -> Damage:
    """Return a damage that replaces text in a file of the building."""

    def damage(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new))

    return damage


def added(file: str, *lines: str) -> Damage:
    """Return a damage that adds records to a file of the building."""
    return replaced(file, "\nend\n", "\n" + "\n".join(lines) + "\nend\n")


def without_map(folder: Path) -> None:
    """Take the ground floor's map away."""
    shutil.rmtree(folder / "maps" / "g")


def stale(folder: Path) -> None:
    """Make tables, then change the graph."""
    assert waychair("building", "tables", folder).returncode == 0
    replaced("submaps/g.txt", "arc from=c2 to=c3", "arc from=c2 to=c3 price_m=9")(folder)


def keep_out(folder: Path) -> None:
    """Draw a keep-out zone over the ward's bed."""
    corners = np.array([(9.0, 2.5), (11.0, 2.5), (11.0, 4.0), (9.0, 4.0)])
    save_zones(folder / "maps" / "g", [Zone("works", Rule.KEEP_OUT, corners)])


FAULTS: dict[str, tuple[str, Damage]] = {
    "E1": ("error", added("submaps/g.txt", "node id=x kind=cross x=5 y=4")),
    "E2": (
        "error",
        added(
            "submaps/g.txt",
            *(f"node id=x{k} kind=cross x={10 + 2 * k} y=-3" for k in (-1, 0, 1)),
            *(f"arc from=c2 to=x{k}" for k in (-1, 0, 1)),
        ),
    ),
    "E3": ("warning", added("submaps/g.txt", "node id=x kind=cross x=13 y=1", "arc from=c2 to=x")),
    "E4": ("error", added("submaps/g.txt", "arc from=c3 to=c2")),
    "E5": ("error", replaced("submaps/g.txt", "arc from=c1 to=c2", "arc from=c1 to=c2 length_m=16")),
    "E6": ("error", replaced("submaps/g.txt", "width_m=0.8", "width_m=0.6")),
    "E7": (
        "error",
        replaced("hgraph.txt", "submap path=g/ward name=Ward x=10 ", "submap path=g/ward name=Ward x=10.5 "),
    ),
    "E8": ("error", replaced("hgraph.txt", "stop lift=A storey=1 at=1:v\n", "")),
    "E9": (
        "error",
        replaced("hgraph.txt", "submap path=g/store name=Store", "submap path=g/store name=Store storey=1"),
    ),
    "E10": ("error", replaced("submaps/g.txt", "door from=c3 to=store:d width_m=0.8\n", "")),
    "E11": ("error", replaced("submaps/g/ward.txt", "arc from=d to=e", "arc from=d to=e oneway=yes")),
    "E12": (
        "warning",
        added("submaps/g.txt", *(f"node id=x{k} kind=cross x=7 y={k}" for k in (-2, 2)), "arc from=x-2 to=x2"),
    ),
    "E13": ("error", added("submaps/g/ward.txt", 'node id=f kind=end x=2 y=1 name="BED g"', "arc from=e to=f")),
    "E14": ("error", keep_out),
    "E15": ("error", stale),
    "E16": ("error", without_map),
    "E17": ("error", replaced("submaps/g.txt", "width_m=0.9", "width_m=3")),
    "E18": ("warning", replaced("submaps/g/ward.txt", "arc from=d to=e", 'arc from=d to=e closed="wet floor"')),
    "W1": ("warning", replaced("submaps/g.txt", "arc from=c2 to=c3", 'arc from=c2 to=c3 closed="works"')),
    "W2": (
        "warning",
        added(
            "submaps/g/ward.txt",
            *(f"node id=x{k} kind=end x={1 + k} y=3 name=Seat-{k}" for k in range(8)),
            "arc from=e to=x0",
            *(f"arc from=x{k} to=x{k + 1}" for k in range(7)),
        ),
    ),
    "W3": ("warning", replaced("submaps/g.txt", "arc from=c2 to=c3", "arc from=c2 to=c3 drive_s=7")),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the small building without a fault; its ground floor has a map."""
    folder = tmp_path_factory.mktemp("sound")
    save_map(folder / "map", OccupancyGrid(np.zeros((120, 200), np.int8), 0.1, Pose2(0.0, -6.0)))
    hgraph = renamed(two_storeys())
    goals = {"Bed g": Pose2(10.0, 3.25), "Shelf g": Pose2(15.0, 3.25)}
    save_places(folder / "map", {name: Place(name, pose) for name, pose in goals.items()})
    save_with_map(Building(folder / "clinic", hgraph), "g", folder / "map")
    return folder / "clinic"


def renamed(hgraph: HGraph) -> HGraph:
    """Return the small building with a shelf in its stores."""
    changed = dict(hgraph.submaps)
    for storey in ("g", "1"):
        store = changed[f"{storey}/store"]
        nodes = {**store.nodes, "e": replace(store.nodes["e"], name=f"Shelf {storey}")}
        changed[store.path] = replace(store, nodes=nodes)
    return replace(hgraph, submaps=changed)


def codes(folder: Path, *options: str) -> dict[str, set[str]]:
    """Return the severities of each code that the command prints, and check its exit code and sentences."""
    done = waychair("building", "check", folder, "--json", *options)
    values = json.loads(done.stdout)
    errors = [each for each in values["findings"] if each["severity"] == "error"]
    assert (done.returncode != 0) == bool(errors) == bool(values["errors"])
    found: dict[str, set[str]] = {}
    for each in values["findings"]:
        assert each["place"]
        assert each["sentence"]
        assert each["remedy"]
        found.setdefault(each["code"], set()).add(each["severity"])
    return found


def test_the_sound_building_has_no_finding(sound: Path) -> None:
    assert codes(sound) == {}


@pytest.mark.parametrize("code", FAULTS)
def test_a_building_with_one_fault_is_told_so(sound: Path, tmp_path: Path, code: str) -> None:
    shutil.copytree(sound, tmp_path / "clinic")
    severity, damage = FAULTS[code]
    damage(tmp_path / "clinic")
    found = codes(tmp_path / "clinic", *(("--body", "A") if code == "E6" else ()))
    assert severity in found.get(code, set()), found


def test_a_lift_that_stops_at_a_storey_that_is_not_there_is_refused_with_its_line(sound: Path, tmp_path: Path) -> None:
    shutil.copytree(sound, tmp_path / "clinic")
    replaced("hgraph.txt", "stop lift=A storey=1", "stop lift=A storey=7")(tmp_path / "clinic")
    done = waychair("building", "check", tmp_path / "clinic")
    assert done.returncode == 1
    assert "hgraph.txt, line" in done.stderr
    assert "there is no storey '7'" in done.stderr
