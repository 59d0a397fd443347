"""The editor's server: a building from maps, files of other programs, and requests that are refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from waychair.maps.building.building import load_building
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.simulation.plan.world import load_levels
from waychair.types import Json
from waychair.ui.editor.server import editor_app
from waychair.ui.editor.session import Session

ROUTE_GRAPH = {
    "type": "FeatureCollection",
    "name": "Hall",
    "features": [
        {
            "type": "Feature",
            "properties": {"id": node, "frame": "map", "metadata": {"name": f"Desk {node}"}},
            "geometry": {"type": "Point", "coordinates": [float(node), 0.0]},
        }
        for node in (0, 1)
    ]
    + [
        {
            "type": "Feature",
            "properties": {"id": 2, "startid": 0, "endid": 1},
            "geometry": {"type": "MultiLineString", "coordinates": [[[0.0, 0.0], [1.0, 0.0]]]},
        }
    ],
}


class Client:
    """A page's requests; each names the latest revision."""

    def __init__(self, session: Session) -> None:
        self.web = TestClient(editor_app(session), base_url="http://localhost")
        self.revision = 1

    def post(self, name: str, **values: Any) -> Json:
        """Return the answer to a command."""
        answer: Json = self.web.post(f"/api/building/{name}", json={**values, "revision": self.revision}).json()
        self.revision = answer.get("revision", self.revision)
        return answer


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    """A page of a new building beside the maps of two storeys."""
    for level in load_levels("two_floors"):
        save_map(tmp_path / "maps" / level.level, level.grid)
        save_places(tmp_path / "maps" / level.level, {place.name: place for place in level.places})
    with Session(tmp_path / "clinic") as session:
        yield Client(session)


def test_two_maps_become_a_building_whose_lift_has_the_cabins_of_the_plans(client: Client, tmp_path: Path) -> None:
    assert client.web.get("/api/building/maps").json()["maps"] == ["maps/ground", "maps/upper"]
    for storey, height in (("ground", 0.0), ("upper", 3.5)):
        op = {"do": "add_storey", "id": storey, "name": "", "height": height, "map": f"maps/{storey}"}
        assert client.post("storey", op=op)["done"]
        assert "new places" in client.post("generate", storey=storey)["sentence"]
    stops = [f"{storey}/{room}:p{k}" for storey, room, k in (("ground", "r1", 2), ("upper", "r2", 1))]
    answer = client.post("lift", op={"do": "set_lift", "id": "A", "name": ""}, stops=stops)
    assert answer["sentence"] == "The lift 'A' stops on 2 storeys."
    for stop in answer["lifts"][0]["stops"]:
        assert stop["cabin"] == pytest.approx([9.0, 3.5, 3.1416], abs=0.06)
    assert answer["lifts"][0]["cabin_depth"] == pytest.approx(1.8, abs=0.2)
    assert client.post("save")["sentence"] == "Saved."
    saved = load_building(tmp_path / "clinic")
    assert [stop.storey for stop in saved.hgraph.lifts["A"].stops] == ["ground", "upper"]
    picture = client.web.get("/api/building/grid.png", params={"storey": "upper"})
    assert picture.headers["x-geometry"].split()[2] == "0.05"
    for format_, start in (("geojson", b"{"), ("rmf", b""), ("csv", b"PK")):
        export = client.web.get("/api/building/export", params={"format": format_})
        assert export.status_code == 200
        assert export.content.startswith(start)


@pytest.mark.nightly
def test_a_simulated_chair_drives_an_arc(client: Client) -> None:
    op = {"do": "add_storey", "id": "ground", "name": "", "height": 0.0, "map": "maps/ground"}
    client.post("storey", op=op)
    client.post("generate", storey="ground")
    assert "The chair drove it" in client.post("drive", arc="ground:d1>r2:d1")["sentence"]


def test_an_imported_building_takes_the_drafts_place_and_undo_brings_that_back(client: Client) -> None:
    client.post("edit", op={"do": "change_building", "name": "Before"})
    answer = client.web.post(
        "/api/building/import",
        params={"name": "hall.geojson", "revision": client.revision},
        content=json.dumps(ROUTE_GRAPH),
    ).json()
    assert answer["done"], answer["sentence"]
    assert answer["name"] == "hall"
    client.revision = answer["revision"]
    assert client.post("undo")["name"] == "Before"


def test_impossible_requests_are_answered_and_change_nothing(client: Client) -> None:
    web, revision = client.web, client.revision
    assert web.post("/api/building/edit", content=b"{").status_code == 400
    assert web.post("/api/building/dance", json={"revision": 1}).status_code == 404
    for name, values in (
        ("edit", {"op": {"do": "nothing"}}),
        ("edit", {}),
        ("storey", {"op": {"id": 3}}),
        ("storey", {"op": {"do": "add_storey", "id": "x", "map": "maps/none"}}),
        ("generate", {"storey": "none"}),
        ("align", {"storey": "none"}),
        ("cabin", {"lift": "A", "at": "x:y"}),
        ("lift", {"op": {"do": "set_lift", "id": "A"}, "stops": ["x:y", "z:w"]}),
        ("drive", {"arc": "x:a>b"}),
        ("edit", {"op": {"do": "change_building", "name": "x"}, "revision": 7}),
    ):
        answer = web.post(f"/api/building/{name}", json={"revision": revision, **values}).json()
        assert not answer["done"]
        assert answer["sentence"]
    assert web.get("/api/building", headers={"origin": "http://elsewhere.example"}).status_code == 403
    assert web.get("/api/building").json()["revision"] == revision
