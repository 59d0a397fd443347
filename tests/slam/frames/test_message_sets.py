"""Messages that belong together: none lost, none twice, in order, and the same sets as an exhaustive search."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.frames.message_sets import ApproximateSets, ExactSets, MessageSets

NAMES = ("a", "b", "c")


@dataclass(frozen=True)
class Message:
    """A stamp and its topic."""

    stamp_ns: int
    topic: str


def streams(topics: int, least_gap: int = 1) -> st.SearchStrategy[list[list[int]]]:
    """Ascending stamps of each topic, at least this far apart."""
    gaps = st.lists(st.integers(least_gap, 20), min_size=1, max_size=7)
    return st.lists(gaps.map(lambda steps: np.cumsum(steps).tolist()), min_size=topics, max_size=topics)


def exhaustive(waiting: list[list[int]], penalty: float, widest: float) -> list[tuple[int, ...]]:
    """The definition: repeatedly take the best of all sets with the pivot that are narrow enough."""
    waiting = [list(stamps) for stamps in waiting]
    found = []
    while all(waiting):
        pivot = max(stamps[0] for stamps in waiting)
        holding = [each for each in product(*waiting) if pivot in each and max(each) - min(each) <= widest]
        # A set does not hold the pivot after its topic has moved on, even if another message has its stamp.
        first = next(i for i, stamps in enumerate(waiting) if stamps[0] == pivot)
        holding = [each for each in holding if each[first] == pivot]
        if not holding:
            del waiting[first][0]
            continue
        best = min(holding, key=lambda each: ((1.0 + penalty) * (max(each) - pivot) - (min(each) - pivot), each))
        found.append(best)
        waiting = [[stamp for stamp in stamps if stamp > used] for stamps, used in zip(waiting, best, strict=True)]
    return found


def feed(sets: MessageSets[Message], waiting: list[list[int]], order: list[int]) -> list[tuple[int, ...]]:
    """Feed the messages, those of each topic in order, and the topics in the sequence `order`."""
    left = {name: list(stamps) for name, stamps in zip(NAMES, waiting, strict=False)}
    found = []
    turn = 0
    while any(left.values()):
        name = NAMES[order[turn % len(order)] % len(waiting)] if order else NAMES[0]
        name = name if left[name] else next(other for other in left if left[other])
        turn += 1
        for each in sets.add(name, Message(left[name].pop(0), name)):
            assert tuple(message.topic for message in each) == tuple(left)
            found.append(tuple(message.stamp_ns for message in each))
    return found


def check_counts(sets: MessageSets[Message], found: list[tuple[int, ...]]) -> None:
    """Every message is accounted for exactly once."""
    for queue in sets.queues.values():
        c = queue.counts
        assert c.received == c.used + c.unmatched + c.dropped + c.late + c.repeated + len(queue.waiting)
        assert c.used == len(found)


@given(
    topics=st.integers(1, 3).flatmap(streams),
    order=st.lists(st.integers(0, 2), max_size=12),
    penalty=st.sampled_from([0.0, 0.1, 1.0]),
    widest=st.sampled_from([0.0, 3.0, math.inf]),
)
def test_approximate_sets_equal_those_of_an_exhaustive_search(
    topics: list[list[int]], order: list[int], penalty: float, widest: float
) -> None:
    end = max(map(max, topics)) + 1000
    waiting = [[*stamps, end] for stamps in topics]  # all that is open before is decided by then
    sets = ApproximateSets[Message](NAMES[: len(topics)], 100, max_spread_ns=widest, age_penalty=penalty)
    found = feed(sets, waiting, order)
    assert found == exhaustive(waiting, penalty, widest)
    check_counts(sets, found)


@given(topics=streams(2, least_gap=8), order=st.lists(st.integers(0, 1), max_size=12))
def test_known_gaps_give_the_same_sets_no_later(topics: list[list[int]], order: list[int]) -> None:
    patient, quick = (
        ApproximateSets[Message](NAMES[:2], 100),
        ApproximateSets[Message](NAMES[:2], 100, least_gaps_ns=(8, 8)),
    )
    slow, soon = feed(patient, topics, order), feed(quick, topics, order)
    assert soon[: len(slow)] == slow
    assert soon == exhaustive(topics, 0.0, math.inf)[: len(soon)]


def test_with_a_known_gap_a_set_does_not_wait_for_the_next_message() -> None:
    patient, quick = ApproximateSets[Message](("a", "b")), ApproximateSets[Message](("a", "b"), least_gaps_ns=(50, 50))
    for sets, expected in ((patient, 0), (quick, 1)):
        assert not sets.add("a", Message(100, "a"))
        assert len(sets.add("b", Message(104, "b"))) == expected


@given(
    topics=st.integers(1, 3).flatmap(streams),
    order=st.lists(st.integers(0, 2), max_size=12),
    queue=st.integers(1, 4),
    exact=st.booleans(),
)
def test_no_message_is_used_twice_and_sets_never_cross_and_memory_is_bounded(
    topics: list[list[int]], order: list[int], queue: int, exact: bool
) -> None:
    names = NAMES[: len(topics)]
    sets: MessageSets[Message] = ExactSets(names, queue) if exact else ApproximateSets(names, queue)
    found = feed(sets, topics, order)
    for before, after in pairwise(found):
        assert all(a < b for a, b in zip(before, after, strict=True))
    assert all(len(waits.waiting) <= queue for waits in sets.queues.values())
    check_counts(sets, found)


@given(topics=streams(2), order=st.lists(st.integers(0, 1), max_size=12))
def test_exact_sets_are_all_common_stamps(topics: list[list[int]], order: list[int]) -> None:
    sets = ExactSets[Message](NAMES[:2], 100)
    assert feed(sets, topics, order) == [(stamp, stamp) for stamp in sorted(set(topics[0]) & set(topics[1]))]


@given(stamps=st.lists(st.integers(0, 30), max_size=30), queue=st.integers(1, 5))
def test_any_messages_are_counted_and_kept_in_order(stamps: list[int], queue: int) -> None:
    """Out of order, repeated and late messages included."""
    sets = ApproximateSets[Message](("a", "b"), queue)
    found = []
    for i, stamp in enumerate(stamps):
        name = "ab"[i % 2]
        found += [tuple(m.stamp_ns for m in each) for each in sets.add(name, Message(stamp, name))]
        assert [m.stamp_ns for m in sets.queues[name].waiting] == sorted(m.stamp_ns for m in sets.queues[name].waiting)
    check_counts(sets, found)
    assert all(a < b for before, after in pairwise(found) for a, b in zip(before, after, strict=True))


def test_a_message_that_came_too_early_waits_for_the_one_before_it() -> None:
    sets = ExactSets[Message](("left", "right"))
    for stamp in (2, 1):
        assert not sets.add("left", Message(stamp, "left"))
    assert sets.queues["left"].counts.out_of_order == 1
    assert [each[0].stamp_ns for stamp in (1, 2) for each in sets.add("right", Message(stamp, "right"))] == [1, 2]


def test_an_unknown_topic_is_refused() -> None:
    with pytest.raises(KeyError):
        ExactSets[Message](("left", "right")).add("middle", Message(1, "middle"))
