"""A mapper restored from a checkpoint continues to the same map."""

from __future__ import annotations

import json

import numpy as np
import pytest

from waychair.slam.mapping.checkpoint import mapper_from_state, state_of
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.types import FloatArray, Pose2, SensorFrame


def test_a_mapper_restored_at_any_point_gives_the_same_map(drive: tuple[list[SensorFrame], FloatArray]) -> None:
    frames = drive[0]
    whole, parts = (Mapper(MapperSettings(), Pose2()) for _ in range(2))
    for k, frame in enumerate(frames):
        whole.process(frame)
        parts.process(frame)
        if k in (0, 1, 17, 100, len(frames) - 1):
            parts = mapper_from_state(state_of(parts))
    expected, found = whole.result(), parts.result()
    assert any(edge.kind.value == "loop" for edge in expected.edges)
    np.testing.assert_array_equal(found.trajectory.poses, expected.trajectory.poses)
    np.testing.assert_array_equal(found.trajectory.stamps_ns, expected.trajectory.stamps_ns)
    np.testing.assert_array_equal(found.key_poses, expected.key_poses)
    assert found.key_frames == expected.key_frames
    assert found.counts == expected.counts
    assert len(found.edges) == len(expected.edges)


def test_the_state_is_numbers_and_text_only(drive: tuple[list[SensorFrame], FloatArray]) -> None:
    mapper = Mapper(MapperSettings(), Pose2())
    for frame in drive[0][:30]:
        mapper.process(frame)
    state = state_of(mapper)
    assert all(array.dtype.kind in "biuf" for array in state.values())
    json.loads(bytes(state["tree"]))


def test_an_invalid_mapper_state_is_a_value_error() -> None:
    state = state_of(Mapper(MapperSettings(), Pose2()))
    text = bytes(state["tree"])
    for wrong in (b"", b"[]", b"3", text[:-5], text.replace(b"mapper:Mapper", b"mapper:Nothing"), text.replace(b"waychair.slam", b"subprocess")):  # fmt: skip
        with pytest.raises(ValueError, match=r"."):
            mapper_from_state({**state, "tree": np.frombuffer(wrong, np.uint8)})
    with pytest.raises(ValueError, match="tree"):
        mapper_from_state({})


def without(node: object, kind: str, name: str) -> object:
    """Return the tree of a state without a field, a plain number, of all objects of a class."""
    if not isinstance(node, list):
        return node
    if node[0] == "object":
        kept = {key: without(value, kind, name) for key, value in node[2].items()}
        if node[1].endswith(f":{kind}"):
            del kept[name]
        return [*node[:2], kept]
    return [without(each, kind, name) for each in node]


def test_a_field_that_an_earlier_version_did_not_write_has_its_default(
    drive: tuple[list[SensorFrame], FloatArray],
) -> None:
    frames, mapper = drive[0][:30], Mapper(MapperSettings(), Pose2())
    for frame in frames[:20]:
        mapper.process(frame)
    state = state_of(mapper)

    def earlier(kind: str, name: str) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
        tree = without(json.loads(bytes(state["tree"])), kind, name)
        return {**state, "tree": np.frombuffer(json.dumps(tree).encode(), np.uint8)}

    restored = mapper_from_state(earlier("TrackingState", "doubted"))
    for frame in frames[20:]:
        mapper.process(frame)
        restored.process(frame)
    assert restored.pose() == mapper.pose()
    with pytest.raises(ValueError, match="Edge has no j"):
        mapper_from_state(earlier("Edge", "j"))
