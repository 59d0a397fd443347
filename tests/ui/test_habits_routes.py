"""The rider's own record on the page's server: look, yes, no, erase and the table, behind the token."""

from __future__ import annotations

from pathlib import Path

from starlette.testclient import TestClient

from tests.ui.noted import Noted
from waychair.control.guidance.practice import DecisionMade, RiderDecision
from waychair.planning.movements import MovementKind
from waychair.runtime.rider.habits import Habits
from waychair.ui.server import app

HERE = "http://127.0.0.1:8000"


def test_the_record_is_off_until_a_yes_and_one_press_looks_takes_away_or_erases(port: Noted, tmp_path: Path) -> None:
    path = tmp_path / "habits.jsonl"
    habits = Habits(path)
    with TestClient(app(port, habits=habits), base_url=HERE) as page:
        empty = {"wanted": False, "trouble": "", "drives": [], "places": []}
        assert page.get("/api/habits").json() == empty
        assert not path.exists()
        assert page.post("/api/habits/yes").json()["done"]
        habits.note_decision(DecisionMade("Ground/c2", MovementKind.LEFT, RiderDecision.OTHER, 0.0, 1))
        shown = page.get("/api/habits").json()
        assert shown["places"] == [{"name": "Ground/c2", "right": 0, "other": 1, "level": 2}]
        assert page.get("/api/habits.csv").text == habits.csv()
        assert page.post("/api/habits/no").json()["done"]
        assert not habits.wanted
        assert page.post("/api/habits/erase").json()["done"]
        assert not path.exists()
        assert page.get("/api/habits").json() == empty
        assert page.post("/api/habits/sell").status_code == 404


def test_a_damaged_record_is_said_and_can_be_erased(port: Noted, tmp_path: Path) -> None:
    path = tmp_path / "habits.jsonl"
    path.write_text("rubbish\n")
    with TestClient(app(port, habits=Habits(path)), base_url=HERE) as page:
        assert "is damaged" in page.get("/api/habits").json()["trouble"]
        assert "is damaged" in page.post("/api/habits/yes").json()["sentence"]
        assert page.post("/api/habits/erase").json()["done"]
        assert page.get("/api/habits").json()["trouble"] == ""


def test_nobody_from_the_network_reads_the_record_without_the_token(port: Noted, tmp_path: Path) -> None:
    guarded = app(port, "secret", names=("chair.example",), local=False, habits=Habits(tmp_path / "habits.jsonl"))
    with TestClient(guarded, base_url="http://192.0.2.7:8000") as page:
        assert page.get("/api/habits").status_code == 401
        assert page.get("/api/habits.csv").status_code == 401
        assert page.post("/api/habits/yes").status_code in (401, 403)


def test_a_chair_without_a_building_guides_nobody_and_says_so(port: Noted) -> None:
    with TestClient(app(port), base_url=HERE) as page:
        said = page.post("/api/do/guide", json={"goal": "reception"}).json()
        assert not said["done"]
        assert "no building to guide in" in said["sentence"]
        assert not page.post("/api/do/end_guide").json()["done"]
        assert "invalid" in page.post("/api/do/guide", json={"goal": "reception", "level": 9}).json()["sentence"]


def test_a_chair_without_a_record_answers_a_look_with_nothing(port: Noted) -> None:
    with TestClient(app(port), base_url=HERE) as page:
        look = page.get("/api/habits")
        assert (look.status_code, look.json()) == (200, None)
        assert page.post("/api/habits/yes").status_code in {404, 405}
