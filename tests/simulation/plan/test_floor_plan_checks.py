"""Every possible mistake of a plan is refused by its line, with advice; values at the limits are accepted."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.errors import WorldError
from waychair.simulation.plan.world import World, levels_of, load_world

PLAN = """\
name: hall
size: [10.0, 6.0]
start: [1.0, 1.0, 0.0]
finish: {floor: tiles, walls: plaster, ceiling: panels, height: 2.6}
light: {ambient: 0.2, power: 0.8, spacing: 3.0}
poster_density: 0.2
walls:
  - start: [0.0, 3.0]
    end: [4.0, 3.0]
    material: concrete
    doors: [{name: gate, at: 1.0, width: 1.0}]
    posters:
      - {at: 3.0, side: right, height: 1.4, size: [0.6, 0.8]}
boxes:
  - {centre: [6.0, 0.5], size: [1.0, 0.5], low: 0.2, high: 0.9, material: wood}
tables:
  - {centre: [8.5, 5.0], size: [1.2, 0.8], height: 0.74, top: 0.04, legs: 0.05}
ramps:
  - {start: [5.0, 4.0], end: [7.0, 4.0], width: 1.0, high: 0.1}
thresholds:
  - {centre: [3.0, 1.0], size: [0.1, 1.0], height: 0.02}
stairs:
  - {start: [7.5, 1.0], end: [9.5, 1.0], width: 1.0, steps: 6, rise: 0.17}
pits:
  - {centre: [9.5, 3.0], size: [0.5, 0.5], depth: 0.8}
lamps:
  - {at: [5.0, 3.0], height: 2.5, power: 1.2}
people:
  - {behaviour: path, path: [[1.0, 2.2], [5.0, 2.2]], speed: 0.8, yields: true, radius: 0.25}
  - {behaviour: bounce, count: 2, speed: 0.2, radius: 0.15}
places:
  desk: [4.5, 1.0, 0.0]
routes:
  mapping: [[2.0, 1.0], [5.0, 1.0]]
"""

BUILDING = """\
name: house
levels:
  - name: ground
    size: [6.0, 4.0]
    start: [1.0, 1.0, 0.0]
    walls: []
    lifts: [{name: lift, middle: [5.0, 3.0, 3.1], size: [1.6, 1.4]}]
    boxes:
      - {centre: [3.0, 3.0], size: [0.5, 0.5]}
  - name: upper
    size: [6.0, 4.0]
    start: [1.0, 1.0, 0.0]
    walls: []
    lifts: [{name: lift, middle: [5.0, 3.0, 3.1], size: [1.6, 1.4]}]
    places:
      bed: [2.0, 2.0, 0.0]
"""


def _world(tmp_path: Path, text: str, level: str | None = None) -> World:
    path = tmp_path / "plan.yaml"
    path.write_text(text, encoding="utf-8")
    return load_world(path, level)


def _line(text: str, piece: str) -> int:
    return text[: text.index(piece)].count("\n") + 1


def test_the_plan_changed_below_is_valid(tmp_path: Path) -> None:
    world = _world(tmp_path, PLAN)
    assert len(world.people) == 3
    assert (len(world.slopes), len(world.pits), len(world.lamps)) == (1, 2, 1)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("floor: tiles", "floor: tile", r"finish\.floor: unknown material 'tile'; did you mean 'tiles'"),
        ("ceiling: panels", "ceiling: gold", r"finish\.ceiling: unknown material 'gold'"),
        ("height: 2.6", "height: 1.2", r"finish\.height: expected `float` >= 1\.5"),
        ("ambient: 0.2", "ambient: 1.5", r"light\.ambient: expected `float` <= 1\.0"),
        ("spacing: 3.0", "space: 3.0", r"light\.space: unknown key; did you mean 'spacing'"),
        ("poster_density: 0.2", "poster_density: -1.0", "poster_density: expected `float` >= 0.0"),
        ("material: concrete", "material: concret", r"walls\[0\]\.material: .* did you mean 'concrete'"),
        ("{name: gate, at: 1.0", "{material: oak, at: 1.0", r"doors\[0\]\.material: unknown material 'oak'"),
        ("width: 1.0}]", "width: 4.5}]", r"doors\[0\]\.width: a door of 4\.5 m is wider than its wall of 4 m"),
        (
            "at: 3.0, side: right",
            "at: 3.9, side: right",
            r"posters\[0\]\.at: .* lies outside its wall of 4 m; move it inside",
        ),
        ("at: 3.0, side: right", "at: 1.5, side: right", r"posters\[0\]\.at: .* hangs in the door at 1 m; move it"),
        ("height: 1.4, size", "height: 2.3, size", r"posters\[0\]\.height: .* reaches beyond its wall"),
        ("height: 1.4, size", "height: 0.3, size", r"posters\[0\]\.height: .* reaches beyond its wall"),
        ("side: right", "side: up", r"posters\[0\]\.side: "),
        ("high: 0.9", "high: 0.2", r"boxes\[0\]\.high: 0\.2 m is not above its lower face at 0\.2 m; raise it"),
        ("high: 0.9", "high: 2.7", r"boxes\[0\]\.high: 2\.7 m is above the ceiling at 2\.6 m; make it lower"),
        ("low: 0.2", "low: -0.2", r"boxes\[0\]\.low: expected `float` >= 0"),
        ("top: 0.04", "top: 0.8", r"tables\[0\]\.top: .* leaves no space for the legs of a table 0\.74 m high"),
        ("legs: 0.05", "legs: 0.5", r"tables\[0\]\.legs: legs of 0\.5 m do not fit under 1\.2 x 0\.8 m"),
        ("height: 0.74", "height: 3.0", r"tables\[0\]\.height: 3 m is above the ceiling"),
        ("centre: [8.5, 5.0]", "centre: [8.5, 7.0]", r"tables\[0\]\.centre: \(8\.5, 7\) lies outside; move it into"),
        ("end: [7.0, 4.0]", "end: [5.0, 4.0]", r"ramps\[0\]\.end: the ramp has no length"),
        ("end: [7.0, 4.0]", "end: [11.0, 4.0]", r"ramps\[0\]\.end: \(11, 4\) lies outside"),
        ("height: 0.02}", "height: 0.05}", r"thresholds\[0\]\.height: expected `float` <= 0\.03"),
        ("end: [9.5, 1.0]", "end: [7.5, 1.0]", r"stairs\[0\]\.end: the stairs have no length"),
        ("steps: 6", "steps: 0", r"stairs\[0\]\.steps: expected `int` >= 1"),
        ("centre: [9.5, 3.0]", "centre: [10.5, 3.0]", r"pits\[0\]\.centre: .* lies outside"),
        ("height: 2.5, power", "height: 2.7, power", r"lamps\[0\]\.height: 2\.7 m is above the ceiling at 2\.6 m"),
        ("at: [5.0, 3.0]", "at: [5.0, -3.0]", r"lamps\[0\]\.at: \(5, -3\) lies outside"),
        ("behaviour: path", "behaviour: walk", r"people\[0\]\.behaviour: unknown behaviour 'walk'; did you mean"),
        ("behaviour: path", "behaviour: sochial", r"did you mean 'social'"),
        ("path: [[1.0, 2.2], [5.0, 2.2]]", "path: [[1.0, 2.2]]", r"people\[0\]\.path: .* at least 2 points, not 1"),
        ("[5.0, 2.2]]", "[1.0, 2.2]]", r"people\[0\]\.path: \(1, 2\.2\) comes twice"),
        ("[5.0, 2.2]]", "[2.5, 4.0]]", r"people\[0\]\.path\[1\]: .* lies in something solid"),
        ("[5.0, 2.2]]", "[8.5, 1.2]]", r"people\[0\]\.path\[1\]: .* lies over a pit"),
        ("[5.0, 2.2]]", "[5.0, 2.2], [2.0, 2.8]]", r"people\[0\]\.path\[2\]: .* nearer to something solid than 0\.25"),
        ("[[1.0, 2.2],", "[[1.3, 1.0],", r"people\[0\]\.path\[0\]: .* too near to the chair's start; move it away"),
        ("speed: 0.8", "speed: 0.0", r"people\[0\]\.speed: expected `float` > 0"),
        ("radius: 0.25}", "count: 3}", r"people\[0\]\.count: 3 people at one place"),
        ("count: 2", "count: 0", r"people\[1\]\.count: expected `int` >= 1"),
        ("radius: 0.15}", "radius: 2.5}", r"people\[1\]\.radius: expected `float` <= 0\.6"),
        ("desk: [4.5, 1.0, 0.0]", "desk: [8.0, 1.0, 0.0]", r"places\.desk: \(8, 1\) lies over a pit; move it"),
        ("desk: [4.5, 1.0, 0.0]", "desk: [3.0, 3.0, 0.0]", r"places\.desk: \(3, 3\) lies in something solid"),
        ("desk: [4.5, 1.0, 0.0]", "desk: [8.5, 5.0, 0.0]", r"places\.desk: .* lies in something solid"),
        ("[5.0, 1.0]]", "[8.5, 2.0], [8.5, 0.5]]", r"routes\.mapping\[2\]: .* lies over a pit"),
        ("start: [1.0, 1.0, 0.0]", "start: [8.0, 1.0, 0.0]", "start: .* lies over a pit"),
        ("places:", "lifts: [{name: a, middle: [5.0, 5.0, 0.0], size: [1.0, 1.0]}]\nplaces:", "on one level only"),
    ],
)
def test_a_mistake_is_refused_by_file_and_line(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert PLAN.count(old) >= 1
    spoilt = PLAN.replace(old, new, 1)
    with pytest.raises(WorldError, match=rf"plan\.yaml, line {_line(PLAN, old)}: .*{named}"):
        _world(tmp_path, spoilt)


@pytest.mark.parametrize(
    ("old", "new", "level", "line", "named"),
    [
        ("name: upper", "name: ground", None, 10, r"levels\[1\]\.name: there is a level 'ground' already; rename one"),
        (
            "[5.0, 3.0, 3.1], size: [1.6",
            "[4.9, 3.0, 3.1], size: [1.6",
            None,
            7,
            r"lifts\[0\]\.middle: .* has another middle",
        ),
        ("size: [1.6, 1.4]", "size: [1.5, 1.4]", None, 7, "has another middle or size on another level"),
        ("{name: lift", "{name: left", None, 7, r"levels\[0\]\.lifts\[0\]\.name: .* stops on one level only"),
        ("centre: [3.0, 3.0]", "centre: [5.0, 3.2]", None, 7, r"levels\[0\]\.lifts\[0\]: .* is blocked by something"),
        ("bed: [2.0, 2.0, 0.0]", "bed: [9.0, 2.0, 0.0]", "upper", 16, r"levels\[1\]\.places\.bed: .* outside"),
        (
            "bed: [2.0, 2.0, 0.0]",
            "bed: [2.0, 2.0]",
            None,
            16,
            r"levels\[1\]\.places\.bed: expected `array` of length 3",
        ),
        ("    boxes:", "    boxs:", None, 8, r"levels\[0\]\.boxs: unknown key; did you mean 'boxes'"),
        ("levels:", "storeys: 2\nlevels:", None, 2, "storeys: unknown key; did you mean"),
        ("    size: [6.0, 4.0]\n", "", None, 3, r"levels\[0\]: .* missing required field `size`"),
        (BUILDING[BUILDING.index("levels:") :], "levels: []\n", None, 2, "without levels; give at least one"),
    ],
)
def test_a_mistake_between_levels_is_refused_by_file_and_line(
    tmp_path: Path, old: str, new: str, level: str | None, line: int, named: str
) -> None:
    assert old in BUILDING
    with pytest.raises(WorldError, match=rf"plan\.yaml, line {line}: .*{named}"):
        _world(tmp_path, BUILDING.replace(old, new, 1), level)


def test_a_lift_is_given_once_for_each_level(tmp_path: Path) -> None:
    twice = "lifts: [{name: lift, middle: [5.0, 3.0, 3.1], size: [1.6, 1.4]}, {name: lift, "
    with pytest.raises(WorldError, match=r"line 7: levels\[0\]\.lifts\[1\]\.name: there is a lift 'lift' already"):
        _world(tmp_path, BUILDING.replace("lifts: [{name: lift, ", twice, 1))


def test_levels_are_chosen_by_name_and_the_first_is_the_default(tmp_path: Path) -> None:
    assert _world(tmp_path, BUILDING).level == "ground"
    upper = _world(tmp_path, BUILDING, "upper")
    assert (upper.name, upper.level, [place.name for place in upper.places]) == ("house", "upper", ["bed"])
    assert levels_of(tmp_path / "plan.yaml") == ("ground", "upper")
    with pytest.raises(WorldError, match="'house' has no level 'attic': take one of ground, upper"):
        _world(tmp_path, BUILDING, "attic")


def test_a_plan_without_levels_has_one_level_of_its_own_name(tmp_path: Path) -> None:
    assert _world(tmp_path, PLAN).level == "hall"
    assert levels_of(tmp_path / "plan.yaml") == ("hall",)


def test_too_many_movers_for_the_space_are_refused(tmp_path: Path) -> None:
    crowd = PLAN.replace("count: 2, speed: 0.2, radius: 0.15", "count: 200, speed: 0.2, radius: 0.6")
    with pytest.raises(
        WorldError, match=r"line 28: people: only \d+ of 201 people fit on the free floor; make them fewer or smaller"
    ):
        _world(tmp_path, crowd)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("height: 2.5, power", "height: 2.6, power"),
        ("high: 0.9", "high: 2.6"),
        ("height: 1.4, size", "height: 2.2, size"),
        ("at: 3.0, side: right", "at: 3.7, side: right"),
        ("at: 3.0, side: right", "at: 1.8, side: right"),
        ("height: 0.02}", "height: 0.03}"),
        ("legs: 0.05", "legs: 0.4"),
        ("width: 1.0}]", "width: 2.0}]"),
        ("steps: 6", "steps: 1"),
        ("high: 0.1}", "high: 0.1, low: 0.1}"),
    ],
)
def test_values_at_the_limits_are_accepted(tmp_path: Path, old: str, new: str) -> None:
    assert PLAN.count(old) >= 1
    assert _world(tmp_path, PLAN.replace(old, new, 1)).grid.cells.any()
