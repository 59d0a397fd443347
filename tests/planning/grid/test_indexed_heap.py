"""The queue against a plain sorted dictionary."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.planning.grid.indexed_heap import NEIGHBOURHOOD, Heap, empty_heap, grown, has_room, put, remove

PLACED = np.dtype([("other", np.int64), ("place", np.int32)])

OPERATIONS = st.lists(
    st.tuples(st.integers(0, 29), st.integers(0, 5), st.integers(0, 5), st.sampled_from(["put", "remove", "pop"])),
    max_size=200,
)


def queue(cell_count: int, capacity: int) -> Heap:
    return empty_heap(np.zeros(cell_count, PLACED), capacity)


@given(OPERATIONS)
@settings(max_examples=100, deadline=None)
def test_the_heap_always_returns_a_cell_with_the_smallest_key(operations: list[tuple[int, int, int, str]]) -> None:
    heap, reference = queue(30, 64), dict[int, tuple[int, int]]()
    for cell, first, second, what in operations:
        if what == "put":
            put(*heap, cell, first, second)
            reference[cell] = (first, second)
        elif what == "remove" or not reference:
            remove(*heap, cell)
            reference.pop(cell, None)
        else:
            top = int(heap.entries["cell"][1])
            assert reference[top] == min(reference.values())
            remove(*heap, top)
            del reference[top]
        assert heap.size[0] == len(reference)
        assert {int(c) for c in heap.entries["cell"][1 : 1 + heap.size[0]]} == set(reference)
        for other, key in reference.items():
            assert heap.entries[["first", "second"]][heap.cells["place"][other]].item() == key


def test_keys_beyond_32_bits_are_compared_exactly() -> None:
    heap = queue(2, 16)
    put(*heap, 0, 1 << 60, (1 << 60) + 1)
    put(*heap, 1, 1 << 60, 1 << 60)
    assert heap.entries["cell"][1] == 1


def test_a_full_heap_grows_and_keeps_its_order() -> None:
    heap = queue(100, 10)
    put(*heap, 0, 99, 0)
    assert has_room(heap)
    put(*heap, 1, 98, 0)
    assert not has_room(heap)
    heap = grown(heap)
    assert has_room(heap)
    for cell in range(2, 12):
        put(*heap, cell, 99 - cell, 0)
    order = []
    while heap.size[0]:
        order.append(int(heap.entries["cell"][1]))
        remove(*heap, order[-1])
    assert order == list(range(11, -1, -1))
    assert not np.any(heap.cells["place"])


@pytest.mark.parametrize("grows", [False, True])
def test_three_entries_for_comparison_follow_the_last_one_at_any_size(grows: bool) -> None:
    heap = grown(queue(200, 14)) if grows else queue(200, 14)
    while has_room(heap):
        put(*heap, int(heap.size[0]), 10, 0)
    for _ in range(NEIGHBOURHOOD - 1):  # the entries that one step may still insert, after the one checked before
        put(*heap, int(heap.size[0]), 10, 0)
    behind = heap.entries["first"][heap.size[0] + 1 :]
    assert len(behind) >= 3
    assert (behind == np.iinfo(np.int64).max).all()
