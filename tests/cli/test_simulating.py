"""`waychair worlds`, `waychair simulate` and `waychair demo --world`, as a user types them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from waychair.recording import read_recording
from waychair.simulation.world import shipped_worlds
from waychair.trials.demo import run_demo
from waychair.types import Odometry

WAYCHAIR = Path(sys.executable).parent / "waychair"

PLAN = """\
name: hall
size: [8.0, 6.0]
start: [1.5, 3.0, 0.0]
walls:
  - {start: [0.0, 0.0], end: [8.0, 0.0]}
  - {start: [8.0, 0.0], end: [8.0, 6.0]}
  - {start: [8.0, 6.0], end: [0.0, 6.0]}
  - {start: [0.0, 6.0], end: [0.0, 0.0]}
boxes:
  - {centre: [4.0, 5.5], size: [1.2, 0.6]}
  - {centre: [5.5, 0.5], size: [0.6, 0.6]}
places:
  window: [6.0, 3.6, 0.0]
routes:
  mapping: [[6.0, 3.0], [2.0, 3.0]]
  short: [[2.5, 3.0]]
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "hall.yaml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def waychair(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(WAYCHAIR), *map(str, arguments)], capture_output=True, text=True, check=False)


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one sentence on standard error of a command that failed as it should."""
    assert done.returncode == 1, done.stdout
    assert "Traceback" not in done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("waychair: ")]
    return sentence


def test_worlds_lists_every_world_with_its_size_doors_and_route_lengths() -> None:
    done = waychair("worlds")
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in shipped_worlds())
    for fact in ("56 x 25", "mapping 203", "mapping 140", "bath 0.815", "fire_door"):
        assert fact in done.stdout


def test_simulate_records_a_bag_that_can_be_read_again(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    done = waychair("simulate", "--world", plan, "--route", "short", "--record", bag, "--seed", "4")
    assert done.returncode == 0, done.stderr
    assert "no contacts" in done.stdout
    assert str(bag) in done.stdout
    frames = read_recording(bag).frames
    assert len(frames) > 20
    last = [reading for frame in frames for reading in frame.wheels if isinstance(reading, Odometry)][-1].odom_from_base
    assert (last.x, last.y) == pytest.approx((1.0, 0.0), abs=0.15)


def test_simulate_without_a_bag_writes_nothing_and_quiet_says_nothing(plan: Path, tmp_path: Path) -> None:
    done = waychair("simulate", "--world", plan, "--route", "short", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["hall.yaml"]


def test_an_unknown_world_or_route_is_one_sentence_with_those_that_exist(plan: Path) -> None:
    sentence = refused(waychair("simulate", "--world", "castle"))
    assert all(name in sentence for name in shipped_worlds())
    assert "mapping, short" in refused(waychair("simulate", "--world", plan, "--route", "scenic"))
    assert "castle" in refused(waychair("demo", "--world", "castle"))


def test_a_broken_plan_is_one_sentence_with_its_line(plan: Path) -> None:
    plan.write_text(PLAN.replace("window: [6.0, 3.6, 0.0]", "window: [4.0, 5.5, 0.0]"), encoding="utf-8")
    assert f"{plan}, line 13: places.window" in refused(waychair("simulate", "--world", plan))


def test_a_recording_that_exists_is_kept(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "mine.mcap"
    bag.write_text("mine", encoding="utf-8")
    assert "mine.mcap" in refused(waychair("simulate", "--world", plan, "--route", "short", "--record", bag))
    assert bag.read_text(encoding="utf-8") == "mine"


def test_a_route_through_a_wall_of_the_chairs_width_is_refused_where_it_touches(plan: Path) -> None:
    plan.write_text(PLAN.replace("short: [[2.5, 3.0]]", "short: [[7.7, 3.0]]"), encoding="utf-8")
    assert "touched something at" in refused(waychair("simulate", "--world", plan, "--route", "short"))


def test_demo_drives_to_all_places_of_a_world_of_few(plan: Path, tmp_path: Path) -> None:
    demo = run_demo(tmp_path / "demo", seed=2, world=plan)
    assert [(leg.place, leg.reached, leg.contacts) for leg in demo.legs] == [("window", True, 0)]
    assert demo.title.startswith("hall")
    assert json.loads((tmp_path / "demo" / "map" / "report.json").read_text())["frames"] > 50
    again = run_demo(tmp_path / "demo", seed=2, world=plan)  # a second run replaces the first one's recording
    assert again.legs[0].error_m == demo.legs[0].error_m
