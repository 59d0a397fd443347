"""The audit of a log: a sound run breaks no rule, and each broken rule is named."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache

import pytest

from tests.planning.fleet.small_traffic import TEE
from waychair.errors import TaskError
from waychair.planning.fleet.audit import audited
from waychair.planning.fleet.waits import Audit
from waychair.trials.fleet.fleet_ordered import Stops, chairs_on
from waychair.types import Json


@cache
def sound_log() -> tuple[Json, ...]:
    records: list[Json] = []
    world = chairs_on(TEE, 4, 3, stops=Stops(share=0.1), audit=Audit(), log=records.append)
    assert world.run(1_200_000)
    assert len(world.done) > 20
    return tuple(records)


def test_a_sound_run_breaks_no_rule_and_its_arrivals_and_waits_are_counted() -> None:
    found = audited(sound_log())
    assert found.faults == []
    assert found.records == len(sound_log())
    assert sum(found.arrivals.values()) > 20
    assert found.hours == pytest.approx(1200 / 3600, rel=0.05)
    assert found.waits_of(2) == [each for each in found.waits if each["waits"] == 2]
    assert sum(found.seconds_by_place().values()) == pytest.approx(sum(each["real_s"] for each in found.waits))
    share = found.foreseen_right()
    assert share is not None
    assert share > 0.8


def _first(records: list[Json], event: str) -> int:
    return next(k for k, each in enumerate(records) if each["event"] == event)


def _into_another(records: list[Json]) -> None:
    """Let a chair enter the resource that another one is in."""
    k = _first(records, "entered")
    other = next(name for name in records[0]["chains"] if int(name) != records[k]["chair"])
    records[k]["resource"] = records[0]["chains"][other][1][0]


def _one_slot_for_two(records: list[Json]) -> None:
    chains = next(each for each in records if each["event"] == "order" and each["t_ms"] == 0 and each is not records[0])
    one, other = list(chains["chains"])[:2]
    chains["chains"][one][1][-1] = chains["chains"][other][1][-1]


def _overtaken_thrice(records: list[Json]) -> None:
    next(iter(records[-1 - _first(records[::-1], "order")]["chains"].values()))[2] = 3


def _ring(records: list[Json]) -> None:
    """Let two chairs wait for each other."""
    order = records[0]
    one, other = (int(name) for name in list(order["chains"])[:2])
    order["chains"][str(one)][1] += [9001, 9002]
    order["chains"][str(other)][1] += [9002, 9001]
    order["queues"] = {"9001": [[other, 2], [one, 1]], "9002": [[one, 2], [other, 1]]}


def _backwards(records: list[Json]) -> None:
    records[-1]["t_ms"] = -1


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (_into_another, "which it was not granted next"),
        (_into_another, ", in which chair "),
        (_one_slot_for_two, "are sent to one slot"),
        (_overtaken_thrice, "has been overtaken 3 times"),
        (_ring, "the order has a cycle"),
        (_backwards, "time runs backwards"),
    ],
)
def test_a_broken_rule_is_named(spoil: Callable[[list[Json]], None], told: str) -> None:
    records = deepcopy(list(sound_log()))
    spoil(records)
    assert any(told in fault for fault in audited(records).faults)


def test_a_chair_that_stands_ten_minutes_with_a_free_way_is_named() -> None:
    records = [
        {"event": "order", "t_ms": 0, "chains": {"1": [0, [4, 5], 0]}, "queues": {}},
        {"event": "entered", "t_ms": 700_000, "chair": 1, "visit": 1, "resource": 5},
    ]
    assert "chair 1 stood 12 min with a free way" in audited(records).faults[0]


@pytest.mark.parametrize(
    "record",
    [{"event": "entered", "t_ms": 0, "chair": 9}, {"t_ms": "soon"}, {"event": "order", "t_ms": 0, "chains": 3}],
)
def test_a_damaged_record_is_refused_by_its_number(record: Json) -> None:
    with pytest.raises(TaskError, match="record 2 of the log is damaged"):
        audited([sound_log()[0], record])


def test_two_chairs_with_top_at_once_or_one_for_too_long_break_the_rules() -> None:
    def given(t_ms: int, chair: int, name: str, until_ms: int) -> Json:
        return {"event": "priority", "t_ms": t_ms, "chair": chair, "priority": name, "until_ms": until_ms}

    good = [given(0, 1, "top", 600_000), given(1, 2, "appointment", 10**7), given(600_000, 2, "top", 700_000)]
    assert audited(good).faults == []
    back = {"event": "priority", "t_ms": 5, "chair": 1, "priority": "routine"}
    assert audited([good[0], back, given(9, 2, "top", 60_000)]).faults == []
    assert "TOP at once" in audited([good[0], given(9, 2, "top", 60_000)]).faults[0]
    assert "more than 10 min" in audited([given(0, 1, "top", 600_001)]).faults[0]
    with pytest.raises(TaskError, match="record 1 of the log is damaged"):
        audited([{"event": "priority", "t_ms": 0, "chair": 1, "priority": "top"}])
