"""`waychair worlds`, `waychair simulate` and `waychair demo --world`, as a user types them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import cv2
import pytest
from rosbags.highlevel import AnyReader

from tests.cli.command import WAYCHAIR, refused, waychair
from tests.halls import mapped_hall
from waychair.recordings.recording import read_recording
from waychair.simulation.plan.world import shipped_worlds
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.trials.demo.demo import run_demo
from waychair.types import Odometry

PLAN = mapped_hall("  window: [6.0, 3.6, 0.0]\n", routes="  short: [[2.5, 3.0]]\n")


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "hall.yaml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def test_worlds_lists_every_world_with_its_size_doors_routes_and_hazards() -> None:
    done = waychair("worlds")
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in shipped_worlds())
    for fact in (
        "56 x 25",
        "mapping 203",
        "mapping 140",
        "4: 0.8 to",
        "ramp 1:12",
        "two_floors, upper",
        "glass",
        "pit",
    ):
        assert fact in done.stdout


def test_worlds_describes_one_world_with_the_names_of_its_doors_and_draws_it(tmp_path: Path) -> None:
    picture = tmp_path / "plan.png"
    done = waychair("worlds", "apartment", "--picture", picture)
    assert done.returncode == 0, done.stderr
    assert "0.815" in done.stdout
    assert "second_floor" not in done.stdout
    height, width = cv2.imread(str(picture)).shape[:2]
    assert min(height, width) > 500
    upper = waychair("worlds", "two_floors", "--level", "upper")
    assert "two_floors, upper" in upper.stdout
    assert "ground" not in upper.stdout


def test_a_level_or_picture_without_a_world_and_an_unknown_level_are_refused(tmp_path: Path) -> None:
    assert "need the name of a world" in refused(waychair("worlds", "--picture", tmp_path / "plan.png"))
    assert "ground, upper" in refused(waychair("worlds", "two_floors", "--level", "attic"))
    assert "ground, upper" in refused(waychair("simulate", "--world", "two_floors", "--level", "attic"))
    assert list(tmp_path.iterdir()) == []


def topics(bag: Path) -> dict[str, int]:
    with AnyReader([bag]) as reader:
        return {connection.topic: connection.msgcount for connection in reader.connections}


@pytest.mark.skipif(renderer_problem() is not None, reason=f"no camera: {renderer_problem()}")
def test_a_recording_holds_all_sensors_at_their_rates(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    done = waychair("simulate", "--world", plan, "--route", "short", "--record", bag)
    assert (done.returncode, "without the camera" in done.stderr) == (0, False), done.stderr
    counts = topics(bag)
    seconds = counts["/odom"] / 50.0
    rates = {topic: count / seconds for topic, count in counts.items() if topic != "/tf_static"}
    expected = {"/scan": 10, "/odom": 50, "/tf": 50, "/joint_states": 50, "/imu/data": 200, "/ground_truth/odom": 20}
    expected |= {f"/sonar_{k}": 20 for k in range(8)}
    expected |= {
        f"/camera/{kind}/{what}": 15
        for kind in ("color", "aligned_depth_to_color")
        for what in ("image_raw", "camera_info")
    }
    assert rates == pytest.approx(expected, abs=2.5 / seconds)  # a short drive loses samples at its ends


def test_a_machine_that_cannot_render_simulates_without_a_camera_and_warns(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    command = [str(WAYCHAIR), "simulate", "--world", str(plan), "--route", "short", "--record", str(bag), "--quiet"]
    nothing = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/none", "__EGL_VENDOR_LIBRARY_DIRS": "/none"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | nothing)
    assert (done.returncode, done.stdout) == (0, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("waychair: simulating without the camera: ")
    assert "/imu/data" in topics(bag)
    assert not [topic for topic in topics(bag) if topic.startswith("/camera")]


def test_simulate_records_a_readable_bag(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    done = waychair("simulate", "--world", plan, "--route", "short", "--record", bag, "--no-camera", "--seed", "4")
    assert done.returncode == 0, done.stderr
    assert not [topic for topic in topics(bag) if topic.startswith("/camera")]
    assert "no contacts" in done.stdout
    assert str(bag) in done.stdout
    frames = read_recording(bag).frames
    assert len(frames) > 20
    last = [reading for frame in frames for reading in frame.wheels if isinstance(reading, Odometry)][-1].odom_from_base
    assert (last.x, last.y) == pytest.approx((1.0, 0.0), abs=0.15)


def test_realtime_takes_as_long_as_the_simulated_time(plan: Path) -> None:
    done = waychair("simulate", "--world", plan, "--route", "short", "--mode", "realtime")
    assert done.returncode == 0, done.stderr
    found = re.search(r"([\d.]+) times real time", done.stdout)
    assert found is not None, done.stdout
    assert 0.3 < float(found[1]) <= 1.03
    assert (float(found[1]) < 0.9) <= ("could not keep real time" in done.stderr)
    assert waychair("simulate", "--world", plan, "--mode", "slow").returncode != 0


@pytest.mark.nightly
def test_an_interrupted_simulation_keeps_its_recording_and_names_its_path(plan: Path, tmp_path: Path) -> None:
    waychair("simulate", "--world", plan, "--route", "short", "--quiet")  # compile the kernels
    bag = tmp_path / "drive.mcap"
    command = [str(WAYCHAIR), "simulate", "--world", str(plan), "--mode", "realtime", "--record", str(bag)]
    command.append("--no-camera")
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.glob(".drive.*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(3.0)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=30)
    assert run.returncode == 130
    assert f"waychair: stopped; what was recorded so far is in {tmp_path / 'drive.part.mcap'}" in said
    assert len(read_recording(tmp_path / "drive.part.mcap").frames) >= 5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drive.part.mcap", "hall.yaml"]


def test_another_chair_and_the_physical_plant_can_be_chosen(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "drive.mcap"
    arguments = ("simulate", "--world", plan, "--route", "short", "--record", bag, "--no-people", "--no-camera")
    done = waychair(*arguments, "--chair", "B", "--plant", "mujoco", "--seed", "2")
    assert done.returncode == 0, done.stderr
    assert "no contacts" in done.stdout
    assert len(read_recording(bag).frames) > 20
    assert "there is no chair 'Z'" in refused(waychair("simulate", "--world", plan, "--chair", "Z"))


def test_simulate_without_a_bag_writes_nothing_and_quiet_says_nothing(plan: Path, tmp_path: Path) -> None:
    done = waychair("simulate", "--world", plan, "--route", "short", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["hall.yaml"]


def test_an_unknown_world_or_route_gives_one_sentence_with_the_known_ones(plan: Path) -> None:
    sentence = refused(waychair("simulate", "--world", "castle"))
    assert all(name in sentence for name in shipped_worlds())
    assert "mapping, short" in refused(waychair("simulate", "--world", plan, "--route", "scenic"))
    assert "castle" in refused(waychair("demo", "--world", "castle"))


def test_a_broken_plan_gives_one_sentence_with_its_line(plan: Path) -> None:
    plan.write_text(PLAN.replace("window: [6.0, 3.6, 0.0]", "window: [4.0, 5.5, 0.0]"), encoding="utf-8")
    assert f"{plan}, line 13: places.window" in refused(waychair("simulate", "--world", plan))


def test_an_existing_recording_is_kept(plan: Path, tmp_path: Path) -> None:
    bag = tmp_path / "mine.mcap"
    bag.write_text("mine", encoding="utf-8")
    assert "mine.mcap" in refused(waychair("simulate", "--world", plan, "--route", "short", "--record", bag))
    assert bag.read_text(encoding="utf-8") == "mine"


def test_a_route_too_close_to_a_wall_is_refused_with_the_place_of_contact(plan: Path) -> None:
    plan.write_text(PLAN.replace("short: [[2.5, 3.0]]", "short: [[7.7, 3.0]]"), encoding="utf-8")
    assert "touched something at" in refused(waychair("simulate", "--world", plan, "--route", "short"))


@pytest.mark.nightly
def test_the_demo_drives_to_all_places_of_a_small_world(plan: Path, tmp_path: Path) -> None:
    demo = run_demo(tmp_path / "demo", seed=2, world=plan)
    assert [(leg.place, leg.reached, leg.contacts) for leg in demo.legs] == [("window", True, 0)]
    assert demo.world.startswith("hall")
    assert json.loads((tmp_path / "demo" / "map" / "report.json").read_text())["frames"] > 50
    again = run_demo(tmp_path / "demo", seed=2, world=plan)  # a second run replaces the first recording
    assert again.legs[0].error_m == demo.legs[0].error_m
