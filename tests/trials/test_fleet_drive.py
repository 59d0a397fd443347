"""Whole chairs that share a building: scenes, the demo's report, its command, and its page."""

from __future__ import annotations

import http.client
import json
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from tests.runtime.riding import coarse_arcs
from waychair.errors import TaskError
from waychair.maps.traffic.corridors import CorridorPlan, floor_plan_names, load_corridors
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.trials.fleet.fleet_demo import (
    FleetDemo,
    fleet_report,
    plan_of,
    view_of,
    waits_by_place,
    write_fleet_report,
)
from waychair.trials.fleet.fleet_drive import FleetMoment, FleetRun, FleetScene, drive_fleet
from waychair.trials.fleet.fleet_scenes import SCENARIOS, rooms_scene
from waychair.ui.fleet_page import FleetPage, fleet_page

SMALL = CorridorPlan("small", (16.0, 6.0), ((2.0, 3.0, 14.0, 3.0),))


def _two_in_a_corridor() -> FleetScene:
    scene = rooms_scene(SMALL, 1, 1, 0)
    names = list(scene.places)
    return replace(scene, starts=(names[0], names[3]), goals=((names[1],), (names[2],)), time_limit_s=90.0)


@pytest.fixture(scope="module")
def driven() -> tuple[FleetScene, FleetRun, list[FleetMoment]]:
    scene = _two_in_a_corridor()
    moments: list[FleetMoment] = []
    with coarse_arcs():
        return scene, drive_fleet(scene, moments.append), moments


def test_two_whole_chairs_reach_their_rooms_without_a_contact_or_a_line_passed(
    driven: tuple[FleetScene, FleetRun, list[FleetMoment]],
) -> None:
    _, run, moments = driven
    assert run.finished
    assert run.contacts == run.lockups == 0
    assert max(chair.over_line for chair in run.chairs) <= 0.05
    assert all(chair.metres > 1.0 for chair in run.chairs)
    assert run.nearest > 0.1
    assert moments[-1].reached != (0, 0)


def test_the_report_has_the_figures_that_are_asked_for(
    driven: tuple[FleetScene, FleetRun, list[FleetMoment]], tmp_path: Path
) -> None:
    scene, run, _ = driven
    demo = FleetDemo(scene, run, 1.0, waits_by_place(run))
    write_fleet_report(tmp_path, demo)
    values = json.loads((tmp_path / "report.json").read_text())
    assert values == json.loads(json.dumps(fleet_report(demo)))
    wanted = {"chairs", "goals", "goals_reached", "contacts", "lockups", "delay_s", "waits", "jain"}
    assert wanted <= values.keys()
    assert (values["chairs"], values["goals"], values["goals_reached"], values["contacts"]) == (2, 2, 2, 0)
    page = (tmp_path / "report.html").read_text()
    assert "2 of 2 goals reached" in page
    assert "chair 1" in page


def test_the_page_shows_all_chairs_and_refuses_foreign_hosts(
    driven: tuple[FleetScene, FleetRun, list[FleetMoment]],
) -> None:
    scene, _, moments = driven
    page = FleetPage()
    page.plan, page.view = plan_of(scene), asdict(view_of(scene, moments[-1]))
    with fleet_page(page) as address:
        at = urlsplit(address)

        def get(path: str, host: str = "") -> tuple[int, bytes]:
            link = http.client.HTTPConnection(at.hostname or "", at.port, timeout=5)
            link.request("GET", path, headers={"Host": host} if host else {})
            answer = link.getresponse()
            return answer.status, answer.read()

        assert get("/")[0] == get("/fleet.js")[0] == get("/theme.css")[0] == 200
        assert len(json.loads(get("/view")[1])["chairs"]) == 2
        plan = json.loads(get("/plan")[1])
        assert plan["size"] == pytest.approx([16.0 - 2 * plan["corner"][0], 6.0 - 2 * plan["corner"][1]], abs=0.1)
        assert get("/view", host="evil.example")[0] == 403
        assert get("/../server.py")[0] == 404


@pytest.mark.parametrize("name", floor_plan_names())
@pytest.mark.parametrize("seed", [0, 1])
def test_goals_of_a_round_differ_and_no_last_goal_is_wanted_by_another_chair(name: str, seed: int) -> None:
    scene = rooms_scene(load_corridors(name), 2, 3, seed)
    for k in range(3):
        assert len({goals[k] for goals in scene.goals}) == 2
    counts = Counter(goal for goals in scene.goals for goal in goals)
    assert all(counts[goals[-1]] == 1 for goals in scene.goals)
    for start, goals in zip(scene.starts, scene.goals, strict=True):
        assert all(a != b for a, b in zip((start, *goals), goals, strict=False))


def test_the_same_seed_gives_the_same_goals_and_another_one_others() -> None:
    scenes = [rooms_scene(load_corridors("T"), 3, 3, seed) for seed in (4, 4, 5)]
    assert scenes[0].goals == scenes[1].goals != scenes[2].goals


def test_more_chairs_than_the_rooms_allow_are_refused() -> None:
    with pytest.raises(TaskError, match="rooms, not enough for 9 chairs"):
        rooms_scene(load_corridors("T"), 9, 3, 0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_chair_of_a_scene_fits_at_its_start_and_at_its_goals(name: str) -> None:
    scene = SCENARIOS[name](0).scene
    solid = solid_from_blocks(scene.world.blocks, scene.world.pits)
    for place in scene.places.values():
        assert not in_contact(solid, scene.body, place.pose)
    assert {*scene.starts, *(goal for goals in scene.goals for goal in goals)} <= scene.places.keys()
    assert np.isfinite(scene.mapped.cells).all()


@pytest.mark.nightly
@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scene_ends_without_a_contact(name: str) -> None:
    scenario = SCENARIOS[name](0)
    run = drive_fleet(scenario.scene, events=scenario.events)
    assert run.contacts == run.lockups == 0
    assert all(chair.reached == chair.goals for k, chair in enumerate(run.chairs) if k not in scenario.may_fail)


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_report_byte_by_byte() -> None:
    scene = _two_in_a_corridor()
    reports = [json.dumps(fleet_report(FleetDemo(scene, drive_fleet(scene), wall, {}))) for wall in (1.0, 2.0)]
    assert reports[0] == reports[1]
