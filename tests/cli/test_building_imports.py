"""`waychair building generate`, `import` and `export`."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.command import waychair
from tests.maps.rooms.drawn_plans import ward
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.types import Place, Pose2


def storeys(tmp_path: Path) -> Path:
    """Return the folder of a building with two storeys that have the ward's map, joined by nothing yet."""
    maps = tmp_path / "map"
    save_map(maps, ward().grid())
    places = {"Bed": (2.0, 2.0), "Lift": (13.8, 5.5)}
    save_places(maps, {name: Place(name, Pose2(x, y)) for name, (x, y) in places.items()})
    house = tmp_path / "house"
    waychair("building", "new", house, "--name", "House")
    for storey, height in (("g", "0"), ("1", "3.5")):
        waychair("building", "add", house, storey, "--map", maps, "--height", height, "--name", f"Storey {storey}")
    return house


def test_two_mapped_storeys_become_a_building_that_routes_lead_through(tmp_path: Path) -> None:
    house = storeys(tmp_path)

    for storey in ("g", "1"):
        made = waychair("building", "generate", house, storey, "--lift", "A=Lift")
        assert "7 rooms, 7 doors, 6 new places" in made.stdout

    checked = waychair("building", "check", house, "--json")
    assert json.loads(checked.stdout)["errors"] == 0, checked.stdout
    route = waychair("building", "route", house, "--from", "Storey g/Bed/Bed", "--to", "Storey 1/Bed/Bed", "--json")
    legs = json.loads(route.stdout)["legs"]
    assert list(dict.fromkeys(leg["storey"] for leg in legs)) == ["g", "1"]
    length = sum(leg["length_m"] for leg in legs)
    assert 26.0 < length < 38.0  # from the bed to the lift and back, 12 m away each


def test_generate_names_its_mistakes(tmp_path: Path) -> None:
    house = storeys(tmp_path)

    for arguments, sentence in (
        (("attic",), "there is no storey 'attic'"),
        (("g", "--body", "Z"), "--body 'Z' is unknown: give one of A, B"),
        (("g", "--lift", "A"), "--lift is 'A'"),
        (("g", "--lift", "A=Roof"), "storey 'g' has no place 'Roof'"),
    ):
        refused = waychair("building", "generate", house, *arguments, "--quiet")
        assert refused.returncode != 0
        assert sentence in refused.stderr
        assert refused.stderr.count("\n") == 1
    assert not (house / "generated").exists()


def test_a_route_graph_goes_in_and_comes_out(tmp_path: Path) -> None:
    points = [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [x, 0]}, "properties": {"id": x}}
        for x in (0, 3)
    ]
    line = {"type": "LineString", "coordinates": []}
    edge = {"type": "Feature", "geometry": line, "properties": {"id": 9, "startid": 0, "endid": 3, "hue": 7}}
    source, target = tmp_path / "in.geojson", tmp_path / "out.geojson"
    source.write_text(json.dumps({"type": "FeatureCollection", "features": [*points, edge]}))

    made = waychair("building", "import", source, tmp_path / "house")
    waychair("building", "export", tmp_path / "house", target)

    assert "1 storeys, 2 nodes, 1 arcs, 0 lifts" in made.stdout
    assert target.read_bytes() == source.read_bytes()


def test_a_broken_import_leaves_no_folder(tmp_path: Path) -> None:
    (tmp_path / "in.building.yaml").write_text("levels: {}")

    refused = waychair("building", "import", tmp_path / "in.building.yaml", tmp_path / "house")

    assert refused.returncode != 0
    assert "has no levels" in refused.stderr
    assert not (tmp_path / "house").exists()
