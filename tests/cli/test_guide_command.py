"""`waychair guide` and `waychair simulate --rider blind` as a user types them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from tests.halls import mapped_hall
from waychair.simulation.sensors.renderer import renderer_problem


def test_a_guided_drive_that_ends_early_is_told_in_one_sentence_and_its_report_is_kept(tmp_path: Path) -> None:
    done = waychair("guide", "--world", "apartment", "--goal", "kitchen", "--minutes", "0.1", "--out", tmp_path)
    assert refused(done) == "waychair: kitchen was not reached: the time limit was reached"
    assert "did not reach kitchen" in done.stdout
    report = json.loads((tmp_path / "guided.json").read_text())
    assert (report["goal"], report["reached"], report["contacts"], report["seconds"]) == ("kitchen", False, [], 6.0)
    assert report["path"][0][0] < report["path"][-1][0] <= 9.0
    assert {row.split(",")[1] for row in (tmp_path / "symbols.csv").read_text().splitlines()[1:]} == {"said", "felt"}


@pytest.mark.parametrize(
    ("arguments", "moves", "told"),
    [(("--rider", "stick"), True, False), (("--level", "inform"), True, True), (("--level", "guard"), False, False)],
)
def test_riders_and_levels_differ_in_what_is_told(
    arguments: tuple[str, ...], moves: bool, told: bool, tmp_path: Path
) -> None:
    waychair("guide", "--world", "apartment", "--goal", "kitchen", "--minutes", "0.1", "--out", tmp_path, *arguments)
    report = json.loads((tmp_path / "guided.json").read_text())
    assert (report["distance_m"] > 0.2, report["symbols"] > 0) == (moves, told)
    ahead = max(row[5] for row in report["caps_and_stick"])
    assert (ahead > 0.1) == moves


def test_a_blind_rider_is_led_along_a_route_of_the_simulator(tmp_path: Path) -> None:
    plan = tmp_path / "hall.yaml"
    plan.write_text(mapped_hall("  window: [6.0, 3.6, 0.0]\n", routes="  short: [[3.0, 3.0]]\n"), encoding="utf-8")
    done = waychair("simulate", "--world", plan, "--route", "short", "--rider", "blind", "--no-people")
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.partition(" m in ")[0]) > 0.5
    assert "no contacts" in done.stdout
    assert "no simulated driver 'me'" in refused(
        waychair("simulate", "--world", plan, "--route", "short", "--rider", "blind", "--driver", "me")
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--goal", "moon"), "moon"),
        (("--goal", "kitchen", "--driver", "nobody"), "there is no simulated driver 'nobody'"),
        (("--goal", "kitchen", "--body", "C"), "--body 'C' is unknown: give one of A, B"),
        (("--goal", "kitchen", "--layout", "sock"), "there is no layout 'sock'"),
        (("--goal", "kitchen", "--rider", "stick", "--sound", "a.wav"), "leave --sound or --rider stick out"),
        (
            ("--goal", "kitchen", "--sensors", "paper", "--level", "guide"),
            "--level guide: the paper's sensors do not show enough",
        ),
        (("--goal", "door-left", "--rider", "stick"), "a rider who sees steers by the map"),
    ],
)
def test_an_impossible_guided_drive_is_refused(arguments: tuple[str, ...], told: str) -> None:
    assert told in refused(waychair("guide", "--world", "apartment", *arguments))


@pytest.mark.skipif(renderer_problem() is not None, reason=str(renderer_problem()))
def test_a_chair_with_the_papers_sensors_is_led_through_the_next_door_without_a_guard(tmp_path: Path) -> None:
    arguments = ("--goal", "door-ahead", "--sensors", "paper", "--start", "10.4,4.5,0", "--minutes", "1", "--seed", "1")
    done = waychair("guide", "--world", "small_clinic", *arguments, "--out", tmp_path)
    assert (done.returncode, done.stdout.startswith("reached the door ahead")) == (0, True), done.stderr
    report = json.loads((tmp_path / "guided.json").read_text())
    assert (report["sensors"], report["level"], report["goal"]) == ("paper", "inform", "the door ahead")
    assert {tuple(row[1:5]) for row in report["caps_and_stick"]} == {(1.0, 1.0, 1.0, 1.0)}


@pytest.mark.parametrize("minutes", ["nan", "-1", "0", "soon"])
def test_a_time_that_is_none_is_refused(minutes: str) -> None:
    done = waychair("guide", "--world", "apartment", "--goal", "kitchen", "--minutes", minutes)
    assert done.returncode == 2
    assert f"'{minutes}' is no time in minutes above zero" in " ".join(done.stderr.split())
