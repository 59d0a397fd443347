"""Slices of a world: the outline at one height, without hidden stretches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.geometry import rectangle, transform_points
from waychair.simulation.plan.world import load_world
from waychair.simulation.scene.scene import DOOR_HEIGHT, MATERIALS, Block, Reflection, Slice
from waychair.simulation.sensors.height_slices import slice_at
from waychair.types import BoolArray, FloatArray, Pose2


def _block(x: float, y: float, length: float, width: float, theta: float = 0.0, material: str = "plaster") -> Block:
    return Block(Pose2(x, y, theta), length, width, 0.0, 1.0, material)


def _lengths(outline: Slice) -> FloatArray:
    lengths: FloatArray = np.hypot(*(outline.segments[:, 2:] - outline.segments[:, :2]).T)
    return lengths


def _within(points: FloatArray, block: Block) -> BoolArray:
    local = np.abs(transform_points(block.middle.inverse(), points))
    within: BoolArray = np.all(local < np.array([block.length, block.width]) / 2, axis=1)
    return within


def _exposed_length(blocks: list[Block], samples: int = 400) -> float:
    """Length [m] of all sides that are not in or against another opaque block, by many points just outside of them."""
    total = 0.0
    for block in blocks:
        corners = transform_points(block.middle, rectangle(block.length / 2, block.length / 2, block.width / 2))
        for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = end - begin
            out = np.array([along[1], -along[0]]) / math.hypot(*along)
            points = begin + np.linspace(0.0, 1.0, samples)[:, None] * along + 1e-6 * out
            others = [other for other in blocks if other is not block]
            hidden = np.zeros(samples, np.bool_)
            for other in others:
                if MATERIALS[other.material].reflection != Reflection.GLASS:
                    hidden |= _within(points, other)
            total += math.hypot(*along) * float(np.mean(~hidden))
    return total


_blocks = st.builds(
    _block,
    st.integers(-8, 8).map(lambda n: n / 4),
    st.integers(-8, 8).map(lambda n: n / 4),
    st.sampled_from([0.25, 0.5, 1.5]),
    st.sampled_from([0.25, 1.0, 2.0]),
    st.sampled_from([0.0, math.pi / 2, 0.4, -1.1]),
    st.sampled_from(["plaster", "glass", "black_leather"]),
)


@given(st.lists(_blocks, min_size=1, max_size=6))
def test_visible_faces_have_no_opaque_block_before_them(blocks: list[Block]) -> None:
    outline = slice_at(blocks, 0.5)
    assert _lengths(outline).sum() == pytest.approx(_exposed_length(blocks), abs=0.012 * len(blocks) * 4)
    middles = outline.segments.reshape(-1, 2, 2).mean(axis=1)
    along = outline.segments[:, 2:] - outline.segments[:, :2]
    out = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    opaque = [block for block in blocks if MATERIALS[block.material].reflection != Reflection.GLASS]
    assert not any(_within(middles + 1e-5 * out, block).any() for block in opaque)


def test_a_block_gives_its_four_sides_with_the_outside_on_the_right() -> None:
    outline = slice_at([_block(1.0, 2.0, 0.6, 0.2, 0.3, "mirror")], 0.5)
    assert sorted(_lengths(outline)) == pytest.approx([0.2, 0.2, 0.6, 0.6])
    assert set(outline.reflections) == {Reflection.MIRROR}
    for x0, y0, x1, y1 in outline.segments:
        outward = (y1 - y0) * ((x0 + x1) / 2 - 1.0) - (x1 - x0) * ((y0 + y1) / 2 - 2.0)
        assert outward > 0.0


@pytest.mark.parametrize(("height", "seen"), [(-0.01, 0), (0.0, 4), (0.999, 4), (1.0, 0)])
def test_a_block_includes_its_low_height_and_excludes_its_high_one(height: float, seen: int) -> None:
    assert len(slice_at([_block(0.0, 0.0, 1.0, 1.0)], height).segments) == seen


def test_touching_blocks_hide_the_faces_between_them() -> None:
    outline = slice_at([_block(0.0, 0.0, 1.0, 1.0), _block(1.0, 0.0, 1.0, 1.0)], 0.5)
    assert len(outline.segments) == 6
    assert not np.any(np.all(np.abs(outline.segments[:, [0, 2]] - 0.5) < 1e-9, axis=1))


def test_a_wall_against_the_middle_of_another_divides_its_face_in_two() -> None:
    outline = slice_at([_block(0.0, 0.0, 4.0, 0.2), _block(0.0, 1.1, 0.2, 2.0)], 0.5)
    upper = outline.segments[np.all(np.abs(outline.segments[:, [1, 3]] - 0.1) < 1e-9, axis=1)]
    assert sorted(upper[:, [0, 2]].min(axis=1)) == pytest.approx([-2.0, 0.1])
    assert sorted(upper[:, [0, 2]].max(axis=1)) == pytest.approx([-0.1, 2.0])


def test_flush_overlapping_walls_keep_the_outside_of_their_corner() -> None:
    outline = slice_at([_block(0.0, 0.0, 2.0, 0.2), _block(-0.9, 0.9, 0.2, 2.0)], 0.5)
    low, high = outline.segments.reshape(-1, 2).min(axis=0), outline.segments.reshape(-1, 2).max(axis=0)
    assert low == pytest.approx([-1.0, -0.1])
    assert high == pytest.approx([1.0, 1.9])
    corner = np.array([-1.0, -0.1])
    assert np.any(np.hypot(*(outline.segments.reshape(-1, 2) - corner).T) < 1e-9)


def test_faces_in_or_behind_glass_are_kept() -> None:
    inner = _block(0.0, 0.0, 0.2, 0.2)
    assert len(slice_at([inner, _block(0.0, 0.0, 1.0, 1.0, 0.0, "glass")], 0.5).segments) == 8
    assert len(slice_at([inner, _block(0.0, 0.0, 1.0, 1.0)], 0.5).segments) == 4


def test_a_height_without_blocks_gives_an_empty_slice() -> None:
    outline = slice_at([], 0.3)
    assert (outline.segments.shape, outline.reflections.shape) == ((0, 4), (0,))


def test_a_door_is_open_below_its_lintel_only() -> None:
    world = load_world("second_floor")
    door = next(door for door in world.doors if door.name == "restroom")
    for height, closed in ((0.3, False), (DOOR_HEIGHT + 0.1, True)):
        standing = [block for block in world.blocks if block.low <= height < block.high]
        middle = np.array([[door.middle.x, door.middle.y]])
        assert any(_within(middle, block).all() for block in standing) is closed
