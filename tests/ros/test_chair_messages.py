"""The messages between the chair's own nodes, over the wire and back, without ROS."""

from __future__ import annotations

import uuid
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.safety.stops import halt
from waychair.errors import MessageError
from waychair.ros.messages import chair, wire
from waychair.types import DriveMode, Pose2, Twist

NUMBER = st.floats(-1e6, 1e6)
ID = st.integers(0, 2**64 - 1)
STAMP = st.integers(0, 2**31 * 10**9 - 1)
TEXT = st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), max_size=40)
POSE = st.builds(Pose2, NUMBER, NUMBER, st.floats(-3.1, 3.1))


def over_the_wire(message: Any) -> Any:
    return wire.deserialised(wire.serialised(message), message.__msgtype__)


def near(one: Pose2, other: Pose2) -> bool:
    return bool(np.allclose(one.array(), other.array(), atol=1e-9))


@given(STAMP, ID, st.booleans(), st.booleans(), POSE, TEXT, TEXT, st.integers(0, 2**32 - 1))
def test_a_request_arrives_unchanged(
    stamp_ns: int, goal_id: int, active: bool, driving: bool, goal: Pose2, stage: str, reason: str, plans: int
) -> None:
    sent = chair.DriveRequest(stamp_ns, goal_id, active, driving, stamp_ns // 2, goal, stage, reason, plans)
    came = chair.read_drive_request(over_the_wire(chair.drive_request(sent)))
    assert near(came.goal, goal)
    assert replace(came, goal=goal) == sent


@given(STAMP, ID, st.sampled_from(DriveMode), POSE, TEXT, st.booleans(), st.lists(st.tuples(TEXT, TEXT), max_size=4))
def test_a_state_arrives_unchanged(
    stamp_ns: int, goal_id: int, mode: DriveMode, goal: Pose2, text: str, flag: bool, halts: list[tuple[str, str]]
) -> None:
    command = Twist(0.4, -0.1) if flag else None
    sent = chair.DriveReport(
        stamp_ns,
        goal_id,
        mode,
        text,
        flag,
        not flag,
        command,
        text,
        tuple(halts),
        (0.1, -0.2),
        stamp_ns // 2,
        goal,
        text,
    )
    came = chair.read_drive_state(over_the_wire(chair.drive_state(sent)))
    assert near(came.goal, goal)
    assert replace(came, goal=goal) == sent


def test_a_goal_without_a_place_is_refused() -> None:
    sent = chair.DriveRequest(0, 1, goal=Pose2(float("nan"), 0.0, 0.0))
    with pytest.raises(MessageError):
        chair.read_drive_request(over_the_wire(chair.drive_request(sent)))


@dataclass
class Unique:
    """As unique_identifier_msgs/UUID, which is an array of numpy."""

    uuid: Any


def test_goals_of_an_action_have_their_own_ids_and_none_is_the_empty_id() -> None:
    ids = {chair.goal_id_of(Unique(np.frombuffer(uuid.uuid4().bytes, np.uint8))) for _ in range(1000)}
    assert len(ids) == 1000
    assert all(chair.NO_GOAL < goal_id < 2**64 for goal_id in ids)
    assert chair.goal_id_of(Unique(np.zeros(16, np.uint8))) != chair.NO_GOAL


@pytest.mark.parametrize("mode", DriveMode)
def test_a_goal_waits_for_a_confirmation(mode: DriveMode) -> None:
    report = chair.DriveReport(0, 1, mode, halt("unconfirmed").text)
    assert report.waits
    assert not replace(report, reason="no goal").waits
    assert report.driving == (mode in (DriveMode.AUTONOMOUS, DriveMode.ASSISTED))
