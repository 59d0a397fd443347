"""Frames attached to key scans behave as in a list, and take a few numbers each."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.mapping.attached_frames import AttachedFrame, AttachedFrames
from waychair.slam.mapping.checkpoint import object_from_state, state_of
from waychair.types import Pose2

NUMBER = st.floats(-1e3, 1e3)
FRAME = st.builds(
    AttachedFrame,
    st.integers(0, 2**62),
    st.integers(0, 2**31),
    st.builds(Pose2, NUMBER, NUMBER, st.floats(-3.14, 3.14)),
)


def filled(frames: list[AttachedFrame]) -> AttachedFrames:
    kept = AttachedFrames()
    for frame in frames:
        kept.append(frame)
    return kept


@given(st.lists(FRAME, max_size=150), st.data())
def test_attached_frames_behave_like_a_list(frames: list[AttachedFrame], data: st.DataObject) -> None:
    kept = filled(frames)
    assert [kept[k] for k in range(len(kept))] == frames
    assert bool(kept) == bool(frames)
    np.testing.assert_array_equal(kept.stamps_ns, np.array([frame.stamp_ns for frame in frames], np.int64))
    np.testing.assert_array_equal(kept.keys, np.array([frame.key for frame in frames], np.int64))
    np.testing.assert_array_equal(kept.poses, np.array([f.key_from_base.array() for f in frames]).reshape(-1, 3))
    if frames:
        place, other = data.draw(st.integers(-len(frames), len(frames) - 1)), data.draw(FRAME)
        kept[place] = frames[place] = other
        assert [kept[k] for k in range(-len(kept), 0)] == frames


@given(st.lists(FRAME, max_size=20), st.data())
def test_a_selection_is_an_independent_copy_that_can_grow(frames: list[AttachedFrame], data: st.DataObject) -> None:
    kept = filled(frames)
    chosen = data.draw(st.lists(st.integers(0, len(frames) - 1), max_size=20)) if frames else []
    taken = kept.take(chosen)
    taken.append(AttachedFrame(1, 2, Pose2(3.0, 4.0, 0.5)))
    assert [taken[k] for k in range(len(taken) - 1)] == [frames[k] for k in chosen]
    assert taken[-1] == AttachedFrame(1, 2, Pose2(3.0, 4.0, 0.5))
    assert [kept[k] for k in range(len(kept))] == frames


@pytest.mark.parametrize("number", [3, -4, 100])
def test_a_missing_frame_is_refused(number: int) -> None:
    kept = filled([AttachedFrame(k, k, Pose2()) for k in range(3)])
    with pytest.raises(IndexError, match=f"no frame {number} among 3"):
        kept[number]


def test_ten_hours_take_less_than_thirty_megabytes_and_survive_writing() -> None:
    kept = AttachedFrames()
    frame = AttachedFrame(1, 2, Pose2(3.0, 4.0, 0.5))
    for _ in range(100_000):
        kept.append(frame)
    bytes_each = sum(sys.getsizeof(array) for array in (kept._on, kept._poses)) / len(kept)
    assert bytes_each * 360_000 < 30e6
    assert object_from_state(state_of(kept), AttachedFrames)[-1] == frame
