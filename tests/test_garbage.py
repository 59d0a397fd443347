"""Objects from before a block are left out of garbage collection within it, and only there."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from weakref import ref

import pytest

from waychair.garbage import present_left_out


class Ring:
    """An object that only a garbage collection can remove."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture(autouse=True)
def _nothing_left_out() -> Iterator[None]:
    """Begin with nothing left out, and leave out the tests' own modules again."""
    gc.unfreeze()
    yield
    gc.unfreeze()
    gc.freeze()


def test_a_collection_within_the_block_finds_only_objects_made_there() -> None:
    before = ref(old := Ring())
    with present_left_out():
        del old
        within = ref(Ring())
        assert len(gc.get_objects()) < 1000, "nothing else is traversed"
        gc.collect()
        assert (before() is None, within() is None) == (False, True)
    gc.collect()
    assert before() is None


def test_an_inner_block_leaves_the_outer_one_as_it_is() -> None:
    with present_left_out():
        with present_left_out():
            pass
        assert gc.get_freeze_count() > 0
    assert gc.get_freeze_count() == 0
