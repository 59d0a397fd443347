"""Priorities that staff give with their key, and their view of the chairs."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from tests.planning.fleet.small_traffic import traffic
from waychair.errors import TaskError
from waychair.planning.fleet.audit import TOP_LONGEST_MS
from waychair.planning.fleet.order import Order, Request, asked, parked
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Audit, waits
from waychair.planning.fleet.warden import Heard, WardenState, decided
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.desk.staff_desk import StaffDesk, staff_view
from waychair.types import Json

WAYS = ways_of(traffic("line", ["P-a", "a-b", "b-Q", "a-R", "b-S"]), 0.5)
KEY = "open sesame"
MINUTE = 60_000


def asking() -> Order:
    """Return an order with two chairs that want to exchange sides."""
    order = parked(WAYS, {1: "P", 2: "Q"})
    return asked(asked(order, Request(1, 1, "S", 0)), Request(2, 2, "R", 0))


def priorities(order: Order) -> dict[int, Priority]:
    """Return the priorities of the chairs' requests."""
    requests = [*order.waiting, *(chain.request for chain in order.chains.values() if chain.request is not None)]
    return {request.chair: request.priority for request in requests}


def test_a_given_priority_holds_until_its_time_and_is_noted() -> None:
    noted: list[Json] = []
    desk, order = StaffDesk(KEY, noted.append), asking()
    assert desk.applied(order, 0) is order
    assert desk.give(2, "top", KEY, 0, 5) == "Chair 2 has TOP for 5 min."
    assert desk.give(1, "appointment", KEY, 0, 90) == "Chair 1 has APPOINTMENT for 90 min."
    order = desk.applied(order, 1)
    assert priorities(order) == {1: Priority.APPOINTMENT, 2: Priority.TOP}
    assert priorities(desk.applied(order, 5 * MINUTE)) == {1: Priority.APPOINTMENT, 2: Priority.ROUTINE}
    assert desk.give(1, "routine", KEY, 6 * MINUTE) == "Chair 1 has its own priority again."
    assert priorities(desk.applied(order, 6 * MINUTE)) == {1: Priority.ROUTINE, 2: Priority.ROUTINE}
    assert [(each["chair"], each["priority"]) for each in noted] == [(2, "top"), (1, "appointment"), (1, "routine")]
    assert noted[0]["until_ms"] == 5 * MINUTE


def test_a_request_under_way_keeps_its_own_priority_for_afterwards() -> None:
    desk = StaffDesk(KEY)
    order = asked(parked(WAYS, {1: "P"}), Request(7, 1, "S", 0, Priority.APPOINTMENT))
    desk.give(1, "top", KEY, 0)
    district, _, _ = decided(WardenState(desk.applied(order, 0), 3000), Heard(requests=()), 0)
    district, _, _ = decided(district, Heard(requests=district.order.waiting), 0)
    assert district.order.chains[1].request is not None
    assert priorities(desk.applied(district.order, 1)) == {1: Priority.TOP}
    assert priorities(desk.applied(district.order, TOP_LONGEST_MS)) == {1: Priority.APPOINTMENT}


@pytest.mark.parametrize(
    ("give", "told"),
    [
        (lambda desk: desk.give(1, "top", "wrong", 0), "the staff's key is wrong"),
        (lambda desk: desk.give(1, "people", KEY, 0), "there is no priority 'people'"),
        (lambda desk: desk.give(1, "top", KEY, 0, 10.1), "give up to 10 min"),
        (lambda desk: desk.give(1, "top", KEY, 0, float("nan")), "is impossible"),
        (lambda desk: desk.give(1, "appointment", KEY, 0, 0.0), "is impossible"),
    ],
)
def test_impossible_wishes_are_refused(give: Callable[[StaffDesk], str], told: str) -> None:
    desk = StaffDesk(KEY)
    with pytest.raises(TaskError, match=told):
        give(desk)
    assert desk.given(0) == {}


def test_one_chair_has_top_at_a_time() -> None:
    desk = StaffDesk(KEY)
    desk.give(1, "top", KEY, 0, 4)
    with pytest.raises(TaskError, match="chair 1 has TOP for 3 min more: take it back first"):
        desk.give(2, "top", KEY, MINUTE)
    desk.give(1, "top", KEY, MINUTE, 4)  # the same chair again
    assert "has TOP" in desk.give(2, "top", KEY, 5 * MINUTE)


def test_wrong_keys_in_a_row_close_the_desk_for_a_while() -> None:
    desk = StaffDesk(KEY)
    for _ in range(5):
        with pytest.raises(TaskError, match="is wrong"):
            desk.give(1, "top", "guess", 0)
    with pytest.raises(TaskError, match="too many wrong keys: wait 30 s"):
        desk.give(1, "top", KEY, 1)
    assert "has TOP" in desk.give(1, "top", KEY, 30_000)
    with pytest.raises(TaskError, match="at least 8"):
        StaffDesk("short")


def test_the_view_tells_chairs_queues_closures_and_waits() -> None:
    order, audit, desk = asking(), Audit(), StaffDesk(KEY)
    district, _, _ = decided(WardenState(order, 3000), Heard(requests=order.waiting, blocked_ms={"b-S": MINUTE}), 0)
    now_ms = 30_000
    present = waits(district.order, now_ms, 3000)
    audit.note(present, now_ms)
    audit.note((), 50_000)
    desk.give(1, "appointment", KEY, now_ms, 20)
    view = json.loads(json.dumps(staff_view(district.order, present, audit.ended, desk.given(now_ms), now_ms)))
    assert [each["chair"] for each in view["chairs"]] == [1, 2]
    assert [each["at"] for each in view["chairs"]] == ["P", "Q"]
    assert view["chairs"][0]["minutes_left"] == 20.0
    assert view["closed"] == ["b-S"]
    assert {wait.sentence for wait in present} <= {each["told"] for each in view["chairs"]}
    assert [each["real_s"] for each in view["waited"]] == [20.0] * len(present)
    assert len(present) >= 1
    for queue in view["queues"]:
        assert len(queue["chairs"]) > 1
