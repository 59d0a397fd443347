"""What a fleet of processes writes down of itself, and its plan's files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import FleetError
from waychair.runtime.fleet.fleet_file import load_fleet
from waychair.trials.fleet.fleet_demo import FleetDemo, demo_scene, fleet_report, pace_sentence, write_fleet_report
from waychair.trials.fleet.fleet_drive import ChairRun, FleetRun
from waychair.trials.fleet.live.live_fleet import LiveRecord
from waychair.trials.fleet.live.live_plan import DESK, ROUTER, fleet_path, new_plan, read_plan
from waychair.trials.fleet.live.wire import ChairWord, WorldMoment
from waychair.trials.fleet.live.world_process import saved_poses

SCENE = demo_scene("T", 2, 0)
STARTS = [SCENE.places[start].pose for start in SCENE.starts]


def record() -> LiveRecord:
    """Return the record of a fleet that has not begun."""
    return LiveRecord(SCENE, FleetRun([ChairRun(len(goals)) for goals in SCENE.goals]))


def moment(s: float, ahead: float = 0.0, boot: int = 1, contacts: tuple[int, int, int] = (0, 0, 0)) -> WorldMoment:
    """Return a moment in which the first chair is so far [m] from its start."""
    poses = [(STARTS[0].x + ahead, STARTS[0].y, 0.0), (STARTS[1].x, STARTS[1].y, 0.0)]
    return WorldMoment(boot, round(s * 1e9), 1.0, poses, [ahead > 0, False], [-1.0, 2.0], [(1.0, 2.0)], 5.0, contacts)


def test_metres_waits_and_stop_lines_are_taken_from_the_world_and_the_chairs_words() -> None:
    found = record()
    found.note_moment(moment(0.0))
    front = STARTS[0].x + 0.3 + SCENE.body.front
    line = ((front, STARTS[0].y - 1.0), (front, STARTS[0].y + 1.0))
    found.note_word(1, ChairWord(7, "room", line=line, answers_ms=[4.0], notices=["said"]))
    found.note_word(2, ChairWord(8, held=True, told="Waits.", waits=(1, "a-b", "asked earlier", 4_000)))
    for k in range(1, 5):
        found.note_moment(moment(0.1 * k, 0.1 * k))
    found.note_word(2, ChairWord(8, reached=1, took_s=[9.0]))
    found.note_moment(moment(0.5, 0.4))
    first, second = found.run.chairs
    assert first.metres == pytest.approx(0.4)
    assert first.over_line == pytest.approx(0.1, abs=1e-6)
    assert second.waited_s == pytest.approx(0.4)
    assert (second.reached, second.took_s, found.answers_ms, found.notices) == (1, [9.0], [4.0], ["chair 1: said"])
    assert [(each["waits"], each["first"], each["rule"], each["foreseen_s"]) for each in found.run.audit.ended] == [
        (2, 1, "asked earlier", 4.0)
    ]
    view = found.view()
    assert view is not None
    assert [chair["number"] for chair in view.chairs] == [1, 2]


def test_contacts_before_a_restart_of_the_world_count_too_and_a_silent_chair_is_named() -> None:
    found = record()
    found.note_word(1, ChairWord(7, told="driving"))
    found.note_moment(moment(0.0, contacts=(1, 0, 0)))
    found.note_moment(moment(0.1, boot=2))
    found.note_moment(moment(0.2, boot=2, contacts=(0, 2, 0)))
    assert (found.run.chair_contacts, found.run.person_contacts, found.run.contacts) == (1, 2, 3)
    found.heard_s[1] -= 10.0
    view = found.view()
    assert view is not None
    assert [chair["told"] for chair in view.chairs] == [
        "its program has ended, and is started again",
        "its program starts",
    ]


def test_the_report_names_processes_that_ended_and_the_pace(tmp_path: Path) -> None:
    found = record()
    for k in range(30):
        found.note_moment(moment(0.1 * k, 0.01 * k))
    demo = FleetDemo(SCENE, found.run, 9.0, first=1, ended=[(1.0, "'chair 2' ended by signal SIGKILL")], factor=0.5)
    assert fleet_report(demo)["processes"] == {
        "real_time_factor": 0.5,
        "ended": [{"s": 1.0, "what": "'chair 2' ended by signal SIGKILL"}],
    }
    write_fleet_report(tmp_path, demo)
    page = (tmp_path / "report.html").read_text()
    assert "&#x27;chair 2&#x27; ended by signal SIGKILL" in page or "'chair 2' ended by signal SIGKILL" in page
    assert pace_sentence(0.5) in page
    assert "chair 2" in page
    assert "processes" not in fleet_report(FleetDemo(SCENE, found.run, 9.0))


def test_all_programs_of_a_plan_read_the_same_scene_and_find_each_other(tmp_path: Path) -> None:
    plan = new_plan(tmp_path, "T", 2, 0, (DESK,))
    assert read_plan(tmp_path) == plan
    files = [load_fleet(fleet_path(tmp_path, number)) for number in (1, 2, DESK)]
    assert len({each.own_endpoint for each in files}) == 3
    assert all(set(each.other_endpoints) == {o.own_endpoint for o in files if o is not each} for each in files)
    assert files[0].traffic_graph().fingerprint == SCENE.graph.fingerprint
    routed = new_plan(tmp_path / "routed", "T", 2, 0, routed=True)
    assert routed.mode == "client"
    one, router = (load_fleet(fleet_path(tmp_path / "routed", number)) for number in (1, ROUTER))
    assert one.other_endpoints == (router.own_endpoint,)
    (tmp_path / "live.json").write_text("{}")
    with pytest.raises(FleetError, match="holds no fleet of processes"):
        read_plan(tmp_path)


def test_a_world_that_is_started_again_puts_the_chairs_where_they_were(tmp_path: Path) -> None:
    assert saved_poses(tmp_path, SCENE) == (STARTS, 0)
    poses = [[1.0, 2.0, 0.5], [3.0, 4.0, 0.0]]
    (tmp_path / "world.json").write_text(json.dumps({"poses": poses, "now_ns": 7}))
    found, now_ns = saved_poses(tmp_path, SCENE)
    assert now_ns == 7
    np.testing.assert_allclose([(pose.x, pose.y, pose.theta) for pose in found], poses)
    (tmp_path / "world.json").write_text(json.dumps({"poses": poses[:1], "now_ns": 7}))
    assert saved_poses(tmp_path, SCENE)[1] == 0
