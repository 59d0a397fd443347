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
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import TaskError
from waychair.geometry import evenly_spaced
from waychair.maps.drawn.zones import Rule
from waychair.maps.grid.cells import occupied_points
from waychair.maps.traffic.corridors import CorridorPlan, corridor_graph, floor_plan_names, load_corridors
from waychair.maps.traffic.well_formed import well_formed
from waychair.planning.fleet.granting import granted
from waychair.planning.fleet.order import Request, asked, parked
from waychair.planning.fleet.ways import ways_of
from waychair.simulation.plan.world import load_levels
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.scene.scene import PersonBehaviour
from waychair.trials.fleet.bent_floor import MIDDLE, RADIUS
from waychair.trials.fleet.fleet_demo import (
    FleetDemo,
    fleet_report,
    plan_of,
    view_of,
    write_fleet_report,
)
from waychair.trials.fleet.fleet_drive import SPEED, ChairRun, FleetMoment, FleetRun, FleetScene, drive_fleet
from waychair.trials.fleet.fleet_lift import PLACES, WAYS, WORLD, free_up_to_lift, hall_graph, share_lift
from waychair.trials.fleet.fleet_scenes import SCENARIOS, lane_zones, rooms_scene
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
    demo = FleetDemo(scene, run, 1.0)
    write_fleet_report(tmp_path, demo)
    values = json.loads((tmp_path / "report.json").read_text())
    assert values == json.loads(json.dumps(fleet_report(demo)))
    wanted = {"chairs", "goals", "goals_reached", "contacts", "lockups", "delay_s", "waits", "jain"}
    assert wanted <= values.keys()
    assert (values["chairs"], values["goals"], values["goals_reached"], values["contacts"]) == (2, 2, 2, 0)
    page = (tmp_path / "report.html").read_text()
    assert "2 of 2 goals reached" in page
    assert "No bay in its corridors saves anything" in page
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


@pytest.mark.parametrize("name", SCENARIOS)
def test_people_of_a_scene_walk_on_free_floor_and_their_pace_is_the_seeds(name: str) -> None:
    worlds = [SCENARIOS[name](seed).scene.world for seed in (0, 0, 1)]
    walkers = [[each for each in world.people if each.behaviour is PersonBehaviour.PATH] for world in worlds]
    for person in walkers[0]:
        solid = occupied_points(worlds[0].grid)
        way = evenly_spaced(person.path, 0.05)
        assert min(float(np.hypot(*(solid - at).T).min()) for at in way) > person.radius + 0.05
    paces = [[each.speed for each in own] for own in walkers]
    assert paces[0] == paces[1]
    assert not paces[0] or paces[0] != paces[2]


def test_two_chairs_meet_on_a_mapped_floor_whose_sections_follow_the_bend() -> None:
    graph = SCENARIOS["mapped_bend"](0).scene.graph
    assert well_formed(graph) == ()
    assert [refuge.name for refuge in graph.refuges if refuge.waiting] == ["niche"]
    bent = [section for section in graph.sections if len(section.points) > 2]
    for section in bent:
        points = np.array(graph.way(section.name))[:, :2]
        in_bend = points[(points[:, 0] > 5.0) & (points[:, 1] < 9.0)]
        assert np.abs(np.hypot(*(in_bend - MIDDLE).T) - RADIUS).max() < 0.6  # in the corridor, by the niche as well
        chord = points[-1] - points[0]
        aside = np.abs((points - points[0]) @ (-chord[1], chord[0])) / np.hypot(*chord)
        assert aside.max() > 0.4  # on a straight section, stop lines would lie so far off the way
    assert len(bent) == 2


def test_the_plan_of_a_page_has_the_floor_inside_the_walls_only() -> None:
    plan = plan_of(rooms_scene(SMALL, 1, 1, 0))
    area = sum(length * width for _, _, length, width in plan["floor"])
    rooms = 1.5 * 1.5 + 1.5 * 0.15  # beside the corridor, whose edge is 0.6 m from its middle, with the door
    assert area == pytest.approx(13.2 * 1.2 + 4 * rooms, rel=0.1)
    assert len(plan["floor"]) < 60


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
    reports = [json.dumps(fleet_report(FleetDemo(scene, drive_fleet(scene), wall))) for wall in (1.0, 2.0)]
    assert reports[0] == reports[1]


def test_in_a_corridor_without_room_to_spare_a_line_along_the_middle_keeps_chairs_right_and_in_a_wider_one_lanes() -> (
    None
):
    narrow, wide = (SCENARIOS[name](0).scene for name in ("two_pass", "two_wide_pass"))
    for scene in (narrow, wide):
        assert {zone.rule for zone in scene.zones} == {Rule.KEEP_OUT}
    assert {zone.rule for zone in lane_zones(corridor_graph(SMALL, 1.8))} == {Rule.ONE_WAY}
    assert all(section.lanes == 2 for scene in (narrow, wide) for section in scene.graph.sections)
    assert (narrow.graph.sections[0].width, narrow.body.width) == (1.525, 0.60)
    assert (wide.graph.sections[0].width, wide.body.width) == (1.8, 0.70)


def test_three_chairs_stand_free_where_they_begin_and_end_their_rides_and_one_at_a_time_has_the_lift() -> None:
    levels = {world.level: world for world in load_levels(WORLD)}
    for storey, pose in PLACES.values():
        solid = solid_from_blocks(levels[storey].blocks, levels[storey].pits)
        assert not in_contact(solid, CHAIR_A, pose)
    graph = hall_graph()
    assert well_formed(graph) == ()
    order = parked(ways_of(graph, SPEED), {k: start for k, (start, _) in enumerate(WAYS)})
    for k, (_, goal) in enumerate(WAYS):
        order = asked(order, Request(k, k, goal, 0))
    order = granted(order, 0, 3000, np.random.default_rng(0), 20)
    assert sum(free_up_to_lift(order, k) > 0 for k in range(3)) == 1


@pytest.mark.nightly
def test_three_chairs_share_a_lift_without_a_contact() -> None:
    run = share_lift(0)
    assert run.finished
    assert run.contacts == run.lockups == 0
    assert all(chair.end_error is not None and chair.end_error < 0.3 for chair in run.chairs)


def test_a_line_given_across_a_chair_counts_from_there_on_and_any_other_from_itself() -> None:
    run, line = ChairRun(1), np.array([[0.0, 0.0], [0.0, 1.0]])
    run.note_line(line, 0.0)
    run.note_line(line, 0.03)
    assert (run.over_line, run.lines_across) == (0.03, 0)
    run.note_line(line - 0.5, 0.5)
    run.note_line(line - 0.5, 0.52)
    assert (run.over_line, run.lines_across) == (0.03, 1)
    run.note_line(None, 0.0)
    run.note_line(line - 0.5, 0.0)
    run.note_line(line - 0.5 + 1e-3, 0.1)
    assert (run.over_line, run.lines_across) == (0.1, 1)
