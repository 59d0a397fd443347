"""Floor plans: doors in walls, and every mistake refused by its line."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest

from waychair.errors import WorldError
from waychair.maps.grid.cells import occupied_points
from waychair.simulation.plan import floor_plan
from waychair.simulation.plan.plan_file import load_building
from waychair.simulation.plan.world import World, load_world, world_from_plan

PLAN = """\
name: flat
size: [6.0, 4.0]
start: [1.0, 1.0, 0.0]
walls:
  - start: [0.0, 2.0]
    end: [6.0, 2.0]
    doors:
      - {name: kitchen, at: 1.5, width: 0.9}
      - {at: 4.0, width: 1.1}
  - {start: [3.0, 2.0], end: [3.0, 4.0]}
boxes:
  - {centre: [3.0, 0.5], size: [0.4, 0.2]}
places:
  door: [1.5, 2.0, 1.5]
  sink: [1.0, 3.0, 0.0]
routes:
  mapping:
    - [1.5, 1.0]
    - [1.5, 3.0]
  round:
    - [4.0, 1.0]
"""


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plan.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def _world(tmp_path: Path, text: str = PLAN) -> World:
    return load_world(_written(tmp_path, text))


def test_doors_are_gaps_of_their_width_at_their_drawn_place(tmp_path: Path) -> None:
    points = occupied_points(_world(tmp_path).grid)
    wall = points[(abs(points[:, 1] - 2.0) < 0.05)]
    gaps = [(0.95 + 0.1, 1.95), (3.45, 4.55)]
    assert not any(((wall[:, 0] > low) & (wall[:, 0] < high)).any() for low, high in gaps)
    columns = sorted(set(wall[:, 0].round(3)))
    assert len(columns) == round((6.0 - 0.9 - 1.1) / 0.05)
    assert {1.025, 1.975, 3.425, 4.575} <= set(columns)


def test_only_doors_with_names_can_be_closed(tmp_path: Path) -> None:
    (door,) = _world(tmp_path).doors
    assert (door.name, door.width, door.thickness) == ("kitchen", 0.9, 0.1)
    assert (door.middle.x, door.middle.y, door.middle.theta) == pytest.approx((1.5, 2.0, 0.0))


def test_the_plan_that_the_documentation_shows_is_a_world(tmp_path: Path) -> None:
    example = textwrap.dedent((floor_plan.__doc__ or "").split("\n\n")[1])
    world = _world(tmp_path, example)
    assert (world.name, len(world.people), [door.name for door in world.doors]) == ("flat", 1, ["kitchen"])


def test_a_route_is_found_by_its_name(tmp_path: Path) -> None:
    world = _world(tmp_path)
    assert world.route().tolist() == [[1.5, 1.0], [1.5, 3.0]]
    assert world.route("round").tolist() == [[4.0, 1.0]]
    with pytest.raises(WorldError, match="no route 'back': take one of mapping, round"):
        world.route("back")


def test_an_unchecked_plan_and_its_world_have_the_same_figures(tmp_path: Path) -> None:
    path = _written(tmp_path, PLAN.replace("size: [6.0", "resolution: 0.025\nsize: [6.0"))
    (level,) = load_building(path).levels
    grid = world_from_plan(level.plan, "flat").grid
    assert (grid.resolution, grid.cells.shape) == (0.025, (200, 280))


@pytest.mark.parametrize(
    ("old", "new", "line", "named"),
    [
        ("width: 0.9", "width: 6.5", 8, r"walls\[0\]\.doors\[0\]\.width: .* 6\.5 m is wider than its wall of 6 m"),
        ("at: 1.5", "at: 0.4", 8, r"walls\[0\]\.doors\[0\]\.at: .* outside its wall of 6 m"),
        ("at: 4.0", "at: 5.5", 9, r"walls\[0\]\.doors\[1\]\.at: .* outside its wall"),
        ("at: 4.0", "at: 2.4", 9, "overlap"),
        ("{at: 4.0", "{name: kitchen, at: 4.0", 9, "door 'kitchen' already; rename one"),
        ("end: [3.0, 4.0]}", "end: [3.0, 2.0]}", 10, "no length"),
        ("end: [3.0, 4.0]}", "end: [3.0, 4.2]}", 10, r"walls\[1\]\.end: \(3, 4\.2\) lies outside"),
        ("end: [3.0, 4.0]}", "end: [3.0, 4.0], thickness: 0.09}", 10, "thickness: .* at least 0.1 m"),
        ("centre: [3.0, 0.5]", "centre: [3.0, -0.5]", 12, r"boxes\[0\]\.centre: .* lies outside"),
        ("centre: [3.0, 0.5]", "centre: [3.0, .nan]", 12, r"boxes\[0\]\.centre\[1\]: nan is not finite"),
        ("centre: [3.0, 0.5]", "center: [3.0, 0.5]", 12, r"boxes\[0\]\.center: unknown key; did you mean 'centre'"),
        ("{at: 4.0, width", "{at: 4.0, wide", 9, r"doors\[1\]\.wide: unknown key; did you mean 'width'"),
        ("walls:", "wals:", 4, "wals: unknown key; did you mean 'walls'"),
        ("    end: [6.0, 2.0]\n", "", 5, "missing required field `end`"),
        ("at: 4.0", "at: far", 9, r"walls\[0\]\.doors\[1\]\.at: expected `float`, got `str`"),
        ("size: [6.0, 4.0]", "size: [500.0, 500.0]", 2, "too large"),
        ("size: [6.0, 4.0]", "size: [6.0, 4.0]\nresolution: 0.001", 3, "resolution: expected `float` >= 0.005"),
        ("start: [1.0, 1.0, 0.0]", "start: [3.0, 0.5, 0.0]", 3, "start: .* something solid; move it"),
        ("start: [1.0, 1.0, 0.0]", "start: [7.0, 0.5, 0.0]", 3, "start: .* outside the world; move it inside"),
        ("door: [1.5, 2.0, 1.5]", "door: [0.5, 2.0, 1.5]", 14, r"places\.door: \(0\.5, 2\) lies in something solid"),
        ("sink: [1.0, 3.0, 0.0]", "sink: [1.0, 3.0]", 15, r"places\.sink: expected `array` of length 3"),
        ("sink: [1.0, 3.0, 0.0]", "sink: [1.0, 3.0, .inf]", 15, r"places\.sink\[2\]: inf is not finite"),
        ("sink: [1.0, 3.0, 0.0]", "door: [1.0, 3.0, 0.0]", 15, "'door' is given twice"),
        ("    - [4.0, 1.0]", "    - [4.0, north]", 21, r"routes\.round\[0\]\[1\]: expected `float`"),
        ("    - [4.0, 1.0]", "    - [3.0, 3.0]", 21, r"routes\.round\[0\]: \(3, 3\) lies in something solid"),
        ("    - [1.5, 3.0]", "    - [0.5, 3.0]", 19, r"routes\.mapping\[1\]: .* lies in something solid"),
        ("  round:\n    - [4.0, 1.0]", "  round: []", 20, "without points"),
        ("  round:", "  round: [", 21, "correct the YAML"),
        ("  round:", "  round: " + "[" * 3000, 20, "more than 50 nested lists"),
        ("at: 4.0", "at: 2024-13-45", 9, "'2024-13-45' is not a valid value"),
        ("walls:", "walls: &walls\n- *walls", 5, r"'\*walls' contains itself"),
    ],
)
def test_a_mistake_is_refused_by_file_and_line(tmp_path: Path, old: str, new: str, line: int, named: str) -> None:
    assert old in PLAN
    with pytest.raises(WorldError, match=rf"plan\.yaml, line {line}: .*{named}"):
        _world(tmp_path, PLAN.replace(old, new, 1))


@pytest.mark.parametrize("text", ["", "# nothing\n", "- a list\n", "words"])
def test_a_file_without_a_plan_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(WorldError, match=r"plan\.yaml, line 1: .*give"):
        _world(tmp_path, text)


def test_a_plan_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WorldError, match="cannot read"):
        load_world(path)


def test_sizes_at_the_limits_are_accepted(tmp_path: Path) -> None:
    text = PLAN.replace("at: 1.5, width: 0.9", "at: 0.45, width: 0.9").replace("at: 4.0", "at: 5.45")
    assert _world(tmp_path, text.replace("door: [1.5, 2.0, 1.5]", "door: [0.5, 2.0, 1.5]").replace("[1.5, ", "[0.4, "))
