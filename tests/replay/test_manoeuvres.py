"""Recorded manoeuvres through the pilot alone give the reference outputs, and each holds what its name says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from evaluation.runs.part_replays import part_replays
from evaluation.runs.replay import (
    Difference,
    Row,
    Tape,
    differences,
    load_reference,
    load_tape,
    save_reference,
    save_tape,
)
from evaluation.scenes.hazards import Hazard, setup_of

from tests.replay.manoeuvres import MANOEUVRES, door_of
from tests.replay.through_ros import through_ros
from waychair.runtime.black_box.box_file import Tick
from waychair.simulation.scene.contact import clearance, solid_from_blocks
from waychair.types import FloatArray, RgbdFrame, SonarReadings

HERE = Path(__file__).resolve().parent


@dataclass
class Recorded:
    """A recorded manoeuvre."""

    name: str
    tape: Tape

    @cached_property
    def hazard(self) -> Hazard:
        return MANOEUVRES[self.name].scene()

    @cached_property
    def ticks(self) -> list[Tick]:
        return [moment.tick for _, moment in self.tape.moments()]

    @cached_property
    def poses(self) -> FloatArray:
        """The localised poses (T, 3) in map."""
        return np.array([tick.map_from_base.array() for tick in self.ticks])

    @cached_property
    def speeds(self) -> FloatArray:
        """The measured speeds (T,) [m/s]."""
        return np.array([tick.twist.v for tick in self.ticks])

    @property
    def reference(self) -> Path:
        return HERE / "references" / f"{self.name}.json.xz"

    def outputs(self, tape: Tape) -> list[Row]:
        """Return the pilot's present outputs of a tape of this scene."""
        return part_replays(setup_of(self.hazard))["pilot"](tape)

    def arrived(self) -> bool:
        """Return whether the drive ended at the goal, as far as the chair knows."""
        goal = self.hazard.goals[0]
        x, y, theta = self.poses[-1]
        near = math.hypot(x - goal.pose.x, y - goal.pose.y) <= goal.tolerance_m
        turned = abs(math.remainder(theta - goal.pose.theta, math.tau)) <= goal.tolerance_rad
        return self.ticks[-1].stage == "arrived" and near and turned

    def least_clearance(self) -> float:
        """Return the least distance [m] of the outline at a localised pose to what stands in the world, or to a pit."""
        solid = solid_from_blocks(self.hazard.world.blocks, self.hazard.world.pits)
        return min(clearance(solid, self.hazard.body, tick.map_from_base) for tick in self.ticks[::4])


@pytest.fixture(scope="module")
def recorded(request: pytest.FixtureRequest) -> Recorded:
    name = str(request.param)
    path = HERE / "tapes" / f"{name}.tape"
    if request.config.getoption("--record", False):
        save_tape(path, MANOEUVRES[name].taped())
    return Recorded(name, load_tape(path))


def of(*names: str) -> pytest.MarkDecorator:
    """Run a test on these manoeuvres."""
    return pytest.mark.parametrize("recorded", names, indirect=True)


def advice(found: list[Difference]) -> str:
    listed = "\n".join(map(str, found))
    return f'{listed}\nif it is meant, run: pytest tests/replay --update --reason "why", for one alone with -k'


@of(*MANOEUVRES)
def test_the_pilots_outputs_equal_the_reference(recorded: Recorded, request: pytest.FixtureRequest) -> None:
    rows, option = recorded.outputs(recorded.tape), request.config.getoption
    if option("--record", False):
        for row, tick in zip(rows, recorded.ticks, strict=True):
            asked = (tick.stage, pytest.approx(tick.asked.v, abs=5e-3), pytest.approx(tick.asked.omega, abs=5e-3))
            assert (row["stage"], row["v"], row["omega"]) == asked, "the pilot alone does not repeat the drive"
    if option("--record", False) or option("--update", False):
        save_reference(recorded.reference, "pilot", rows, str(option("--reason")))
    found = differences("pilot", load_reference(recorded.reference).rows, rows)
    assert not found, advice(found)


@of("glass", "edge", "jump")
def test_the_same_messages_over_ros_give_the_same_outputs(recorded: Recorded) -> None:
    rows = recorded.outputs(through_ros(recorded.tape, recorded.hazard.goals[0]))
    found = differences("pilot", load_reference(recorded.reference).rows, rows)
    assert not found, advice(found)


@of(*MANOEUVRES)
def test_a_tape_is_small_and_free_of_contacts_and_its_reference_carries_a_reason(recorded: Recorded) -> None:
    files = (HERE / "tapes" / f"{recorded.name}.tape", recorded.reference)
    assert sum(path.stat().st_size for path in files) < 150_000
    assert load_reference(recorded.reference).reasons
    assert recorded.least_clearance() > 0.0


@of("door_rear", "door_mid", "door_front")
def test_the_chair_of_each_drive_passes_the_door(recorded: Recorded) -> None:
    hazard = recorded.hazard
    assert hazard.body.drive == recorded.name.removeprefix("door_")
    assert hazard.body.chair_id == "B"
    middle = door_of(hazard.body.drive).door
    assert middle is not None
    assert recorded.poses[0, 0] < middle.x < recorded.poses[-1, 0]
    in_door = recorded.poses[np.abs(recorded.poses[:, 0] - middle.x) < 0.1]
    assert len(in_door)
    assert (np.abs(in_door[:, 1] - middle.y) < 0.1).all()
    assert recorded.arrived()


@of("corner")
def test_the_chair_turns_the_corner(recorded: Recorded) -> None:
    turned = recorded.poses[-1, 2] - recorded.poses[0, 2]
    assert turned == pytest.approx(math.pi / 2, abs=0.2)
    assert recorded.arrived()


@of("dead_end")
def test_the_chair_turns_about_in_the_dead_end_and_drives_backwards_in_it(recorded: Recorded) -> None:
    assert abs(recorded.poses[0, 2]) < 0.2
    assert recorded.speeds.min() < -0.05
    assert recorded.arrived(), "facing out"


@of("parked")
def test_the_parked_chair_leaves_its_wall(recorded: Recorded) -> None:
    world, body = recorded.hazard.world, recorded.hazard.body
    solid = solid_from_blocks(world.blocks, ())
    assert clearance(solid, body, recorded.ticks[0].map_from_base) < 0.05
    assert clearance(solid, body, recorded.ticks[-1].map_from_base) > 0.5
    assert recorded.arrived()


@of("glass")
def test_the_chair_hears_the_glass_that_its_map_lacks_and_takes_another_way(recorded: Recorded) -> None:
    readings = [message for _, moment in recorded.tape.moments() for message in moment.heard]
    assert any(isinstance(message, SonarReadings) for message in readings)
    assert "offering" in {tick.stage for tick in recorded.ticks}
    assert recorded.ticks[-1].stage == "driving"
    assert recorded.poses[-1, 1] > 3.0  # towards the open door, off the straight way


@of("edge")
def test_the_chair_stops_before_the_edge_that_only_its_camera_sees(recorded: Recorded) -> None:
    pictures = [each for _, moment in recorded.tape.moments() for each in moment.heard if isinstance(each, RgbdFrame)]
    assert len(pictures) > 30
    pit = recorded.hazard.world.pits[0]
    assert recorded.speeds.max() > 0.2
    assert recorded.poses[:, 0].max() < pit.middle.x - pit.length / 2 - recorded.hazard.body.front
    assert recorded.ticks[-1].stage == "waiting"
    assert abs(recorded.speeds[-1]) < 0.01


@of("jump")
def test_the_pose_jumps_in_the_middle_of_the_drive_which_goes_on(recorded: Recorded) -> None:
    steps = [math.dist(a[:2], b[:2]) for a, b in pairwise(recorded.poses.tolist())]
    jump = int(np.argmax(steps))
    assert steps[jump] > 0.2
    before, after = recorded.ticks[jump - 1], recorded.ticks[jump + 1]
    assert (before.stage, after.stage) == ("driving", "driving")
    assert after.located is not None
    assert after.located.jumped
    assert before.twist.v > 0.2
    assert recorded.arrived()


@of("band")
def test_the_line_of_the_harmonic_planner_leads_round_the_boxes_without_a_sharp_turn(recorded: Recorded) -> None:
    assert recorded.hazard.chair.navigator.planner.planner == "harmonic"
    moving = recorded.poses[recorded.speeds > 0.1]
    start, end = moving[0], moving[-1]
    along = np.array([end[0] - start[0], end[1] - start[1]]) / math.dist(start[:2], end[:2])
    off = np.abs((moving[:, :2] - start[:2]) @ np.array([-along[1], along[0]]))
    assert off.max() > 0.2, "it bends"
    turns = np.abs([math.remainder(b[2] - a[2], math.tau) for a, b in pairwise(moving[:: len(moving) // 60])])
    assert np.degrees(turns.max()) < 15.0
    assert recorded.arrived()


def test_every_reference_and_tape_is_of_a_manoeuvre() -> None:
    tapes = {path.stem for path in (HERE / "tapes").iterdir()}
    references = {path.name.removesuffix(".json.xz") for path in (HERE / "references").iterdir()}
    assert tapes == set(MANOEUVRES)
    assert references - {"odometry", "localiser", "pilot", "base"} == set(MANOEUVRES)
