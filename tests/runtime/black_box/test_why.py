"""Explanations of real stops from their black box, in plain sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.runtime.black_box.test_box_file import HEAD, moment_at
from tests.runtime.boxes import Drive, driven, logged
from tests.runtime.riding import Ride
from tests.runtime.test_chair_faults import only
from waychair.control.safety.stops import STOPS
from waychair.errors import BoxError
from waychair.recordings.recording import read_recording
from waychair.runtime.black_box.box_events import OTHER_EVENTS
from waychair.runtime.black_box.box_file import Log, LogEnd, Moment, encoded, read_log
from waychair.runtime.black_box.box_store import segment_files
from waychair.runtime.black_box.box_to_bag import write_bag
from waychair.runtime.black_box.why import Explanation, explain, last_stops, sentences
from waychair.runtime.black_box.why_evidence import LOOK_AT, LogCursor, evidence, look_at, remedy_of
from waychair.simulation.scene.scene import Block
from waychair.trials.record import mounts_of
from waychair.types import Goal, JoystickInput, Pose2, Scan, WheelTicks


def explained(box: Path, script: Callable[[Ride], None], ride: Ride | None = None) -> Explanation:
    logged(box, [driven(script, ride)])
    return explain(last_stops(box)[0])


def figure(explanation: Explanation, pattern: str) -> float:
    """Return the number in a sentence of the evidence."""
    found = [re.search(pattern, sentence) for sentence in explanation.evidence]
    matches = [match for match in found if match]
    assert matches, explanation.evidence
    return float(matches[-1].group(1))


@pytest.fixture(scope="module")
def blind() -> Drive:
    def lidar_falls_silent(ride: Ride) -> None:
        ride.drive(100)
        ride.change = only(WheelTicks)
        ride.tick(40)

    return driven(lidar_falls_silent)


def test_a_silent_lidar_is_named_with_its_age_and_the_place_the_speed_and_the_remedy(
    blind: Drive, tmp_path: Path
) -> None:
    logged(tmp_path, [blind])
    why = explain(last_stops(tmp_path)[0])
    stopped = next(state for _, state, _ in blind.notes[60:] if not state.verdict.computer_drives)
    assert why.id == "lidar_stale"
    assert why.first.startswith("the last scan is too old to drive by (lidar_late")
    assert figure(why, r"last scan was (\d\.\d\d) s old") == pytest.approx(0.55, abs=0.06)
    assert "driving by itself to 10.00, 2.50" in why.doing or "driving by itself to lift" in why.doing
    assert re.search(r"at 0\.(79|8\d) m/s", why.doing)
    assert why.remedy == "check its cable and power"
    assert any("the chair stood after 0." in sentence for sentence in why.followed)
    assert any("the drive was over" in sentence for sentence in why.followed)
    assert math.dist((why.where.x, why.where.y), (stopped.map_from_base.x, stopped.map_from_base.y)) < 0.3
    text = "\n".join(sentences(why))
    for part in ("What it was doing", "What happened first", "What followed", "What to do", "Check also", "wire "):
        assert part in text


def test_the_riders_push_is_reported_with_the_deflection_and_the_threshold(tmp_path: Path) -> None:
    def rider_takes_over(ride: Ride) -> None:
        ride.drive(80)
        ride.simulator.rider = JoystickInput(0, 0.6, -0.3)
        ride.tick(10)
        ride.simulator.rider = JoystickInput(0)
        ride.tick(30)

    why = explained(tmp_path, rider_takes_over)
    assert why.id == "taken_over"
    assert figure(why, r"(\d\.\d\d) forward") == pytest.approx(0.6, abs=0.02)
    assert figure(why, r"(\d\.\d\d) to the right") == pytest.approx(0.3, abs=0.02)
    assert figure(why, r"(\d\.\d\d) takes over") == 0.2


def test_a_press_of_stop_is_reported_as_such(tmp_path: Path) -> None:
    def stop_is_pressed(ride: Ride) -> None:
        ride.drive(80)
        ride.chair.stop()
        ride.tick(40)

    why = explained(tmp_path, stop_is_pressed)
    assert why.id == "stop_pressed"
    assert any("Stop came" in sentence for sentence in why.evidence)


def test_the_obstacle_is_named_with_its_distance(tmp_path: Path) -> None:
    def somebody_puts_a_cupboard_there(ride: Ride) -> None:
        ride.drive(80)
        at = ride.simulator.truth()
        cupboard = Block(Pose2(at.x + 0.75 + 0.45, at.y), 0.2, 3.0, 0.0, 1.5)
        world = ride.simulator.world
        ride.simulator.place(replace(world, blocks=(*world.blocks, cupboard)), at)
        ride.tick(60)

    why = explained(tmp_path, somebody_puts_a_cupboard_there)
    assert why.first.startswith("something is close ahead (obstacle")
    assert 0.2 <= figure(why, r"was (\d\.\d\d) m from the chair, ahead") <= 0.36  # 0.35 m away when it was placed


def test_a_goal_without_a_path_is_a_failed_drive(tmp_path: Path) -> None:
    def goal_in_the_wall(ride: Ride) -> None:
        ride.tick(10)
        ride.chair.go(Goal(Pose2(2.0, 4.95, 0.0)))
        ride.chair.confirm()
        ride.tick(20)

    why = explained(tmp_path, goal_in_the_wall)
    assert why.id == "drive_failed"
    assert "goal" in why.first
    assert "standing" in why.doing


def test_several_stops_are_listed_with_the_latest_first(blind: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [blind])
    logged(tmp_path, [blind])
    stops = [explain(stop) for stop in last_stops(tmp_path, 5)]
    assert [why.id for why in stops] == ["lidar_stale", "lidar_stale"]
    assert stops[0].wall_ns > stops[1].wall_ns


def test_a_crash_is_the_last_stop_even_before_the_program_restarts(blind: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [blind])
    last = segment_files(tmp_path)[-1]
    last.write_bytes(last.read_bytes().removesuffix(encoded(LogEnd())))
    why = explain(last_stops(tmp_path)[0])
    assert why.id == "program_ended"
    assert any("had the lines" in sentence for sentence in why.evidence)
    logged(tmp_path, [blind.without_first(4)])
    assert [explain(stop).id for stop in last_stops(tmp_path, 9)] == ["lidar_stale", "program_ended", "lidar_stale"]


def test_every_hint_belongs_to_an_existing_reason() -> None:
    assert set(LOOK_AT) <= {name.split("_")[0] for name in (*STOPS, *OTHER_EVENTS)}
    assert look_at("lidar_stale")[0] == "the lidar's cable, power and window"


@pytest.mark.parametrize("name", sorted([*STOPS, *OTHER_EVENTS]))
def test_every_reason_has_a_remedy_and_evidence_that_works_with_a_poor_log(name: str) -> None:
    text = STOPS[name].sentence + ": do so" if name in STOPS else ": ".join(OTHER_EVENTS[name])
    assert remedy_of(name, text)
    poor = replace(moment_at(1).tick, telemetry=None, located=None, command=None, goal=None)
    nothing_seen = Scan(1, moment_at(1).heard[1].ranges * math.inf, 0.0, 0.1)  # type: ignore[union-attr]
    for moments in ((Moment(poor),), (moment_at(1), moment_at(2)), (Moment(poor, (nothing_seen,)),)):
        cursor = LogCursor(Log(HEAD, moments, (), 0, 0, None), len(moments) - 1)
        for sentence in evidence(cursor, name):
            assert sentence
            assert "nan" not in sentence


def test_a_bag_of_a_part_holds_its_sensor_messages(blind: Drive, tmp_path: Path) -> None:
    logged(tmp_path / "box", [blind])
    log = last_stops(tmp_path / "box")[0].log
    write_bag(tmp_path / "stop.mcap", log, lambda body: mounts_of(body, 0.3))
    recording = read_recording(tmp_path / "stop.mcap")
    scans = [message for message in log.messages() if isinstance(message, Scan)]
    assert len(recording.frames) == len(scans)
    frame = recording.frames[-1].scan
    assert frame is not None
    assert frame.ranges.tobytes() == scans[-1].ranges.tobytes()
    assert recording.base_from_laser == Pose2(0.6, 0.0, 0.0)
    began = log.ticks[0]
    assert frame.stamp_ns == scans[-1].stamp_ns + began.wall_ns - began.stamp_ns


def test_an_empty_log_gives_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BoxError, match="no sensor message"):
        write_bag(tmp_path / "x.mcap", Log(HEAD, (Moment(moment_at(1).tick),), (), 0, 0, None), lambda body: {})
    assert list(tmp_path.iterdir()) == []


def test_a_box_without_a_stop_says_so(blind: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [Drive({}, blind.notes[10:60])])
    with pytest.raises(BoxError, match="nothing has stopped the chair"):
        last_stops(tmp_path)
    assert read_log(segment_files(tmp_path)).moments


def test_a_missing_an_empty_and_a_damaged_box_have_their_own_errors(blind: Drive, tmp_path: Path) -> None:
    with pytest.raises(BoxError, match="does not exist"):
        last_stops(tmp_path / "none")
    with pytest.raises(BoxError, match="no black box"):
        last_stops(tmp_path)
    (tmp_path / "empty" / "ring").mkdir(parents=True)
    with pytest.raises(BoxError, match="empty or damaged"):
        last_stops(tmp_path / "empty")
    logged(tmp_path / "box", [blind])
    for path in (tmp_path / "box").rglob("*.log"):
        path.write_bytes(b"\x00" * 1000)
    with pytest.raises(BoxError, match="damaged"):
        last_stops(tmp_path / "box")
    for path in (tmp_path / "box").rglob("part.json"):
        path.write_text("not json")
    with pytest.raises(BoxError, match="empty or damaged"):
        last_stops(tmp_path / "box")
