"""A chair under VDA 5050: orders and zone grants become chains and leases, and its messages are the standard's."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.planning.fleet.small_traffic import traffic
from tests.runtime.fleet.vda_fields import faults
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import VdaError
from waychair.planning.fleet.warden import RequestWord
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.vda5050 import vda5050_messages as vda
from waychair.runtime.fleet.vda5050.vda5050_robot import ANSWERS, MANUFACTURER, ChairMoment, VdaChair
from waychair.types import Pose2, Twist

WAYS = ways_of(traffic("ward", ["P-a", "a-b", "b-Q", "a-R"]), 0.5)
NOW_MS = 1_800_000_000_000
SECOND = 1_000_000_000
HEADER = {
    "headerId": 7,
    "timestamp": vda.utc(NOW_MS),
    "version": "3.0.0",
    "manufacturer": MANUFACTURER,
    "serialNumber": "2",
}


def order(names: str, released: int, *, update: int = 0, first: int = 0, order_id: str = "o1", **changed: Any) -> bytes:
    """Return an order along names such as "P P-a a", of which so many are released."""
    parts = [
        {"sequenceId": first + k, "released": k < released, "actions": [], ("edgeId" if k % 2 else "nodeId"): name}
        for k, name in enumerate(names.split())
    ]
    values = {"orderId": order_id, "orderUpdateId": update, "nodes": parts[::2], "edges": parts[1::2]}
    return json.dumps({**HEADER, **values, **changed}).encode()


def answer(chair: VdaChair, zone: str, grant: str, lease_s: float | None = 3.0) -> bytes:
    """Return a fleet control's answer to the chair's request for a zone."""
    requests = state(chair)["zoneRequests"]
    (number,) = [each["requestId"] for each in requests if each["zoneId"] == zone]
    values: dict[str, object] = {"requestId": number, "grantType": grant}
    if lease_s is not None:
        values["leaseExpiry"] = vda.utc(NOW_MS + round(1e3 * lease_s))
    return json.dumps({**HEADER, "responses": [values]}).encode()


def state(chair: VdaChair, moment: ChairMoment | None = None, now_ns: int = 0) -> dict[str, Any]:
    """Return the chair's state as plain values; it must be as the standard lists it."""
    told = chair.state(moment or ChairMoment(Pose2(1.0, 2.0, 0.5)), now_ns, NOW_MS)
    values: dict[str, Any] = json.loads(vda.text_of(told))
    assert faults("state", values) == []
    return values


def spots(chair: VdaChair, now_ns: int = 0) -> list[str]:
    """Return the names of the spots that the chair may use."""
    return [WAYS.names[spot] for spot in chair.reply(now_ns).spots]


def granted(chair: VdaChair, *zones: str, now_ns: int = 0, lease_s: float | None = 3.0) -> None:
    """Ask for the zones on the way, and grant some."""
    chair.ask(now_ns)
    for zone in zones:
        chair.receive("responses", answer(chair, zone, "GRANTED", lease_s), now_ns)


def test_every_word_of_the_standard_for_a_request_is_one_of_the_wardens() -> None:
    assert {grant.value.lower(): ours.value for grant, ours in ANSWERS.items()} == {
        each.value: each.value for each in RequestWord
    }
    assert set(ANSWERS) == set(vda.GrantType)


def test_a_chair_drives_the_base_as_far_as_its_zones_are_granted() -> None:
    chair = VdaChair(WAYS, "2", "P")
    assert (chair.reply(0).answer, spots(chair), chair.arrived) == (RequestWord.GRANTED, ["P"], True)
    chair.receive("order", order("P P-a a a-b b b-Q Q", 5), 0)
    assert (chair.reply(0).answer, spots(chair), chair.goal) == (RequestWord.QUEUED, ["P"], "Q")
    chair.ask(0)
    asked = state(chair)["zoneRequests"]
    assert [(each["zoneId"], each["zoneSetId"], each["requestStatus"]) for each in asked] == [
        ("P-a", "ward", "REQUESTED"), ("a-b", "ward", "REQUESTED"),
    ]  # fmt: skip
    granted(chair, "P-a")
    assert (chair.reply(0).answer, spots(chair)) == (RequestWord.GRANTED, ["P", "P-a", "a"])
    chair.receive("responses", answer(chair, "a-b", "QUEUED"), 0)
    assert spots(chair) == ["P", "P-a", "a"]
    granted(chair, "a-b")
    assert spots(chair) == ["P", "P-a", "a", "a-b", "b"]  # b-Q is horizon
    told = state(chair)
    assert [(each["nodeId"], each["sequenceId"], each["released"]) for each in told["nodeStates"]] == [
        ("a", 2, True), ("b", 4, True), ("Q", 6, False),
    ]  # fmt: skip
    assert [each["edgeId"] for each in told["edgeStates"]] == ["P-a", "a-b", "b-Q"]
    assert (told["lastNodeId"], told["newBaseRequest"]) == ("P", False)


def test_the_state_follows_the_chair_along_its_way_to_the_goal() -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-R R", 5), 0)
    granted(chair, "P-a", "a-R")
    for spot, last, edges, nodes in (
        ("P-a", "P", ["P-a", "a-R"], ["a", "R"]),
        ("a", "a", ["a-R"], ["R"]),
        ("a-R", "a", ["a-R"], ["R"]),
        ("R", "R", [], []),
    ):
        following = chair.reply(0).spots[1]
        assert WAYS.names[following] == spot
        chair.enter(following)
        chair.ask(0)
        told = state(chair)
        assert told["lastNodeId"] == last
        assert [each["edgeId"] for each in told["edgeStates"]] == edges
        assert [each["nodeId"] for each in told["nodeStates"]] == nodes
    assert chair.arrived
    assert state(chair)["zoneRequests"] == []
    with pytest.raises(VdaError, match="P-a is not next on the way: stop"):
        chair.enter(WAYS.names.index("P-a"))


def test_a_lease_is_a_duration_on_the_chairs_clock_and_ends_what_is_not_entered() -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-R R", 5), 0)
    granted(chair, "P-a", "a-R", now_ns=100 * SECOND)
    assert spots(chair, 102 * SECOND) == ["P", "P-a", "a", "a-R", "R"]
    assert spots(chair, 104 * SECOND) == ["P"]
    assert spots(chair, 99 * SECOND) == ["P"]  # a clock that went backwards
    chair.enter(chair.reply(101 * SECOND).spots[1])
    assert spots(chair, 101 * SECOND) == ["P-a", "a", "a-R", "R"]
    assert spots(chair, 104 * SECOND) == ["P-a", "a"]  # it drives out of the zone that it is in
    assert [each["requestStatus"] for each in state(chair, now_ns=104 * SECOND)["zoneRequests"]] == ["EXPIRED"] * 2
    before = {each["requestId"] for each in state(chair)["zoneRequests"]}
    chair.ask(104 * SECOND)
    again = state(chair, now_ns=104 * SECOND)["zoneRequests"]
    assert [each["requestStatus"] for each in again] == ["REQUESTED"] * 2
    assert not before & {each["requestId"] for each in again}


def test_a_grant_without_an_end_lapses_with_the_link_and_a_revoked_one_at_once() -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-R R", 5), 0)
    granted(chair, "P-a", "a-R", lease_s=None)
    assert len(spots(chair, 3600 * SECOND)) == 5
    chair.receive("responses", answer(chair, "a-R", "REVOKED"), 0)
    assert spots(chair) == ["P", "P-a", "a"]
    chair.receive("responses", answer(chair, "P-a", "REJECTED"), 0)
    assert (chair.reply(0).answer, spots(chair)) == (RequestWord.REVOKED, ["P"])
    chair.receive("responses", answer(chair, "P-a", "GRANTED", None), 0)
    assert spots(chair) == ["P", "P-a", "a"]
    chair.link_lost()
    assert spots(chair) == ["P"]


def test_an_update_goes_on_where_the_base_ends_and_an_order_may_be_cancelled() -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-b b", 3), 0)
    chair.receive("order", order("P P-a a a-b b", 3), 0)  # sent twice
    chair.receive("order", order("a a-R R", 3, update=1, first=2), 0)  # another horizon
    assert (state(chair)["errors"], chair.goal) == ([], "R")
    granted(chair, "P-a", "a-R")
    assert spots(chair) == ["P", "P-a", "a", "a-R", "R"]
    chair.enter(chair.reply(0).spots[1])
    cancel = {"actionType": "cancelOrder", "actionId": "c", "blockingType": "HARD"}
    chair.receive("instantActions", json.dumps({**HEADER, "actions": [cancel]}).encode(), 0)
    assert spots(chair) == ["P-a", "a"]  # nobody stops in a section
    told = state(chair)
    assert told["instantActionStates"] == [{"actionId": "c", "actionStatus": "FINISHED", "actionType": "cancelOrder"}]
    chair.enter(chair.reply(0).spots[1])
    assert (chair.reply(0).answer, state(chair)["nodeStates"]) == (RequestWord.REVOKED, [])
    chair.receive("order", order("a a-b b", 3, order_id="o2", first=40), 0)
    assert (state(chair)["errors"], chair.goal, state(chair)["orderId"]) == ([], "b", "o2")


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"\xff\x00", "does not fit VDA 5050 3.0.0"),
        (b"[" * 10_000, "does not fit VDA 5050 3.0.0"),
        (b" " * 1_000_001, "is too long: send at most 1000000"),
        (order("P P-a a", 3).replace(b'"orderId"', b'"orderID"'), "missing required field `orderId`"),
        (order("P P-a a", 3, orderUpdateId=-1), "orderUpdateId"),
        (order("P P-a a", 3, version="2.1.0"), "is of VDA 5050 2.1.0: send 3.0.0"),
        (order("P P-a a", 3, serialNumber="3"), "not for waychair 2"),
        (order("P P-a a a-c c", 5), "no way leads from a to a-c in ward"),
        (order("P P-a b", 3), "no way leads from P-a to b"),
        (order("Q b-Q b", 3), "the order begins at Q, but the chair is at P"),
        (order("P P-a", 2), "1 nodes and 1 edges are no way"),
        (order("P P-a a", 2), "from a node to a node: release it so"),
        (order("P P-a a", 0), "the base is not the first part of the way"),
        (order("P P-a a", 3).replace(b'"sequenceId": 1', b'"sequenceId": 5'), "do not lead from node to edge to node"),
        (order("P P-a a", 3).replace(b'"actions": []', b'"actions": [{"actionType":"pick","actionId":"1","blockingType":"HARD"}]'), "send no actions"),
    ],
)  # fmt: skip
def test_an_order_that_cannot_be_followed_changes_nothing_and_is_an_error_of_the_state(data: bytes, told: str) -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", data, 0)
    (error,) = state(chair)["errors"]
    assert (error["errorType"], error["errorLevel"]) == ("ORDER_REFUSED", "WARNING")
    assert told in error["errorDescription"]
    assert (spots(chair), chair.arrived) == (["P"], True)


def test_updates_that_do_not_fit_are_refused_and_the_order_goes_on() -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-b b", 3, update=4), 0)
    for data, told in (
        (order("P P-a a a-R R", 5, update=3), "update 3 of order o1 is older than 4"),
        (order("b b-Q Q", 3, update=5, first=4), "begins at b, not at a, where its base ends"),
        (order("P P-a a", 3, order_id="o2"), "the chair is still on order o1: cancel it first"),
    ):
        chair.receive("order", data, 0)
        assert told in state(chair)["errors"][-1]["errorDescription"]
    assert (chair.goal, state(chair)["orderUpdateId"]) == ("b", 4)
    lift = {"actionType": "pick", "actionId": "p", "blockingType": "HARD"}
    chair.receive("instantActions", json.dumps({**HEADER, "actions": [lift]}).encode(), 0)
    assert state(chair)["instantActionStates"][0]["actionStatus"] == "FAILED"
    chair.receive("zoneSet", b"{}", 0)
    assert state(chair)["errors"][-1]["errorType"] == "UNKNOWN_TOPIC"


@given(st.binary(max_size=300), st.sampled_from(["order", "responses", "instantActions", "other"]))
def test_random_bytes_neither_crash_nor_grant(data: bytes, topic: str) -> None:
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a", 3), 0)
    chair.ask(0)
    chair.receive(topic, data, 0)
    assert spots(chair) == ["P"]


def test_the_riders_joystick_stop_and_battery_are_in_the_state() -> None:
    chair = VdaChair(WAYS, "2", "P")
    moment = ChairMoment(Pose2(0.0, 0.0, 4.0), Twist(0.3, 0.1), charge=70.0, sentence="Waits before a-b.")
    told = state(chair, moment)
    assert told["mobileRobotPosition"]["theta"] == pytest.approx(4.0 - 6.283185307)
    assert (told["driving"], told["powerSupply"]["stateOfCharge"]) == (True, 70.0)
    assert told["information"][0]["infoDescriptor"] == "Waits before a-b."
    assert (told["operatingMode"], told["safetyState"]["activeEmergencyStop"]) == ("AUTOMATIC", "NONE")
    assert state(chair, replace(moment, by_rider=True))["operatingMode"] == "MANUAL"
    chair.receive("order", order("P P-a a", 3), 0)
    held = state(chair, replace(moment, by_rider=True, stopped=True, blocked=True))
    assert held["operatingMode"] == "INTERVENED"
    assert held["safetyState"] == {"activeEmergencyStop": "MANUAL", "fieldViolation": True}
    assert "mobileRobotPosition" not in state(chair, replace(moment, pose=None))


def test_connection_and_factsheet_are_as_the_standard_lists_them() -> None:
    chair = VdaChair(WAYS, "2", "P")
    for each in vda.ConnectionState:
        values = json.loads(vda.text_of(chair.connection(each, NOW_MS)))
        assert faults("connection", values) == []
    assert (values["headerId"], values["timestamp"]) == (3, "2027-01-15T08:00:00.000Z")
    facts = json.loads(vda.text_of(chair.factsheet(CHAIR_A, 0.8, 0.6, NOW_MS)))
    assert faults("factsheet", facts) == []
    assert facts["physicalParameters"]["width"] == CHAIR_A.width
    assert len(facts["mobileRobotGeometry"]["envelopes2d"][0]["vertices"]) == 4


def test_messages_are_valid_by_the_published_schemas() -> None:
    where = os.environ.get("WAYCHAIR_VDA5050_SCHEMAS")
    if where is None:
        pytest.skip("the published schemas of VDA 5050 are not here: set WAYCHAIR_VDA5050_SCHEMAS to their folder")
    jsonschema = pytest.importorskip("jsonschema")
    chair = VdaChair(WAYS, "2", "P")
    chair.receive("order", order("P P-a a a-b b", 3), 0)
    granted(chair, "P-a")
    messages = {
        "state": chair.state(ChairMoment(Pose2(1.0, 2.0, 0.5), sentence="Waits."), 0, NOW_MS),
        "connection": chair.connection(vda.ConnectionState.ONLINE, NOW_MS),
        "factsheet": chair.factsheet(CHAIR_A, 0.8, 0.6, NOW_MS),
    }
    for name, message in messages.items():
        schema = json.loads((Path(where) / f"{name}.schema").read_text())
        jsonschema.validate(json.loads(vda.text_of(message)), schema)


def test_serial_numbers_and_places_that_are_impossible_are_refused() -> None:
    with pytest.raises(VdaError, match="no serial number for a topic"):
        VdaChair(WAYS, "2/#", "P")
    with pytest.raises(VdaError, match="ward has no node or place 'P-a'"):
        VdaChair(WAYS, "2", "P-a")


def test_timestamps_are_in_utc_with_milliseconds() -> None:
    now_ms = round(time.time() * 1e3)
    assert vda.ms_of(vda.utc(now_ms)) == now_ms
    assert vda.ms_of("2017-04-15T13:40:03.12+02:00") == vda.ms_of("2017-04-15T11:40:03.120Z")
    for wrong in ("yesterday", "2017-04-15T11:40:03"):
        with pytest.raises(VdaError, match="timestamp"):
            vda.ms_of(wrong)
