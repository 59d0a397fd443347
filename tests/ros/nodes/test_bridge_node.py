"""The bridge alone, without a board: messages of unauthorised nodes and of other clocks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.recordings.bags.ros_messages import joint_states, laser_scan, make
from waychair.ros import topics
from waychair.ros.messages.chair import DriveReport, DriveRequest, drive_request, read_drive_state
from waychair.ros.messages.motion import read_twist, twist
from waychair.ros.messages.reports import DiagnosticLevel
from waychair.ros.messages.sensors import battery
from waychair.ros.nodes.inputs import Input
from waychair.types import ChairStatus, JoystickInput, Scan, Twist, WheelTicks

if TYPE_CHECKING:
    from tests.ros.harness import Harness, Heard

HOUR_NS = 3_600_000_000_000


@dataclass
class BridgeAlone:
    """The process, and its states."""

    ros: Harness
    states: Heard

    @property
    def state(self) -> DriveReport:
        """The latest."""
        return read_drive_state(self.states[-1])

    def now_ns(self) -> int:
        return int(self.ros.node.get_clock().now().nanoseconds)

    def next_state(self) -> DriveReport:
        """Return a state made after now."""
        since_ns = self.now_ns()
        self.ros.spin_until(lambda: self.states and self.state.stamp_ns > since_ns, "another state")
        return self.state


@pytest.fixture(scope="module")
def bridge(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[BridgeAlone]:
    cable = Path(tmp_path_factory.mktemp("cable"), "none")
    states = ros.heard(topics.DRIVE_STATE)
    with ros.process("-m", "waychair.ros.nodes.bridge_node", "--ros-args", "-p", f"cable:=pty:{cable}"):
        ros.spin_until(lambda: states, "the bridge")
        yield BridgeAlone(ros, states)
    states.close()


def test_a_bridge_alone_names_all_missing_parts_and_is_not_ready(bridge: BridgeAlone) -> None:
    halts = dict(bridge.next_state().halts)
    assert {"board_unusable", "lidar_stale", "wheels_stale", "localiser_silent"} <= set(halts)
    assert not bridge.state.ready
    assert bridge.state.command is None


def test_scans_of_another_clock_are_named_and_not_taken(bridge: BridgeAlone) -> None:
    send = bridge.ros.publisher(topics.SCAN)

    def scan() -> None:
        old = Scan(bridge.now_ns() - HOUR_NS, np.full(90, 2.0, np.float32), -1.5, 0.03, 0.0, 0.1, 10.0)
        send(laser_scan(old))

    report = bridge.ros.report("input scan", lambda report: "this node's clock" in report.message, scan)
    assert report.level is DiagnosticLevel.ERROR
    assert "3600" in report.message
    halts = dict(bridge.next_state().halts)
    assert "3600.0 s behind" in halts["lidar_clock"]
    assert "lidar_stale" not in halts


@pytest.mark.parametrize("name", ["joint_states", "battery_state"])
def test_sensor_topics_with_best_effort_are_received(bridge: BridgeAlone, name: str) -> None:
    topic = {each.name: each for each in (topics.JOINTS, topics.BATTERY)}[name]
    send = bridge.ros.publisher(replace(topic, qos=topics.SENSOR_DATA))
    messages = {"joint_states": joint_states(WheelTicks(5, 1, 2), 4096), "battery_state": battery(ChairStatus(5))}
    report = bridge.ros.report(
        f"input {name}", lambda report: dict(report.values)["messages"] != "0", lambda: send(messages[name])
    )
    assert "QoS" not in report.message


def test_f26_another_publisher_of_speeds_is_named(bridge: BridgeAlone) -> None:
    bridge.ros.publisher(topics.COMMAND)
    said = "another program commands the chair, too (tests)"  # a new node's name is known a moment later
    bridge.ros.spin_until(lambda: said in dict(bridge.state.halts).get("two_commanders", ""), "the stop and who it is")


def test_delayed_requests_are_refused_and_an_earlier_goal_is_over(bridge: BridgeAlone) -> None:
    send = bridge.ros.publisher(topics.DRIVE_REQUEST)
    for age_ns in (200_000_000, HOUR_NS, -HOUR_NS):
        send(drive_request(DriveRequest(bridge.now_ns() - age_ns, 7, True, True)))
    bridge.ros.report("input drive_request", lambda report: dict(report.values)["messages"] == "3")
    assert bridge.next_state().goal_id == 0
    bridge.ros.spin_until(
        lambda: bridge.state.goal_id == 7,
        "the request",
        lambda: send(drive_request(DriveRequest(bridge.now_ns(), 7, True, True))),
    )
    assert bridge.state.drops_goal, "a goal from before the start of the bridge does not resume by itself"
    assert bridge.state.command is None


def test_a_confirmation_must_name_a_waiting_goal(bridge: BridgeAlone) -> None:
    from waychair.ros.interface_types import interface_type

    kind = interface_type("waychair_msgs/srv/Confirm")
    client = bridge.ros.node.create_client(kind, "confirm")
    bridge.ros.spin_until(client.service_is_ready, "the service")
    for goal_id in (0, 7, 8):
        asked = client.call_async(kind.Request(goal_id=goal_id))
        bridge.ros.spin_until(asked.done, "the answer")
        assert not asked.result().success
        assert asked.result().message == "there is no goal to confirm: request one first"
    assert bridge.next_state().command is None


def test_a_stop_by_topic_is_obeyed_at_once_and_a_confirmation_without_a_goal_refused(bridge: BridgeAlone) -> None:
    bridge.ros.publisher(topics.STOP)(make("std_msgs/msg/Empty", 0))
    bridge.ros.spin_until(lambda: bridge.state.mode.value == "stopped", "the stop")
    assert bridge.state.command is None


def test_a_pages_stick_held_since_before_the_bridge_started_counts_only_after_a_release(
    ros: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.ros.node_settings.bridge import BridgeNodeSettings
    from waychair.ros.nodes import bridge_node
    from waychair.ros.nodes.parts.commanders import PAGE_NODE, Commanders

    obeyed: list[tuple[float, float]] = []
    now_ns = [10**9]
    monkeypatch.setattr(bridge_node.time, "monotonic_ns", lambda: now_ns[0])
    base = SimpleNamespace(let_go=lambda at: None, steer=lambda forward, turn, at: obeyed.append((forward, turn)))

    def begun() -> Any:
        counts: Any = SimpleNamespace(
            pages=1, get_publishers_info_by_topic=lambda topic: [], count_publishers=lambda name: counts.pages
        )
        return SimpleNamespace(
            settings=BridgeNodeSettings(),
            _base=base,
            _is_fresh=lambda stamp_ns: True,
            _commanders=Commanders(counts, {"page_joystick": PAGE_NODE}, now_ns[0]),
            counts=counts,
        )

    def push(node: Any, after_s: float = 0.1) -> int:
        now_ns[0] += round(after_s * 1e9)
        bridge_node.BridgeNode._take_page_joystick(node, JoystickInput(0, 0.5, 0.0))
        return len(obeyed)

    held = begun()
    assert [push(held) for _ in range(50)] == [0] * 50
    bridge_node.BridgeNode._take_page_joystick(held, None)
    assert [push(held), push(held, 5.0)] == [1, 2]
    obeyed.clear()
    fresh = begun()
    for _ in range(30):  # ticks
        now_ns[0] += 100_000_000
        fresh._commanders.check(now_ns[0])
    assert [push(fresh), push(fresh)] == [1, 2], "the page has not pushed since the bridge started"
    fresh.counts.pages = 2
    assert push(fresh) == 3, "a restarted page is known"


def test_on_an_open_network_a_bridge_obeys_no_speeds_and_says_why(ros: Harness) -> None:
    states = ros.heard(topics.DRIVE_STATE, "open/drive_state")
    arguments = ("-r", "__ns:=/open", "-p", "ignore_commands:=true", "-p", "cable:=pty:/none")
    with ros.process("-m", "waychair.ros.nodes.bridge_node", "--ros-args", *arguments):
        ros.spin_until(lambda: states, "the bridge")
        state = read_drive_state(states[-1])
    states.close()
    assert "set up security keys (SROS 2)" in dict(state.halts)["open_network"]
    assert not state.ready


def test_a_seat_switch_is_obeyed_and_a_silent_one_stops_the_chair(ros: Harness) -> None:
    states = ros.heard(topics.DRIVE_STATE, "seat/drive_state")
    arguments = ("-r", "__ns:=/seat", "-p", "fitness.seat_switch:=true", "-p", "cable:=pty:/none")
    with ros.process("-m", "waychair.ros.nodes.bridge_node", "--ros-args", *arguments):
        ros.spin_until(lambda: states, "the bridge")
        assert "status_stale" in dict(read_drive_state(states[-1]).halts)
        send = ros.publisher(topics.SEAT, "seat/seat_occupied")
        for seated, expected in ((False, {"seat_empty"}), (True, set())):
            said = make("std_msgs/msg/Bool", seated)
            ros.spin_until(
                lambda expected=expected: _contacts_of(states) == expected,
                f"the seat to be {seated}",
                lambda said=said: send(said),
            )
        ros.spin_until(lambda: _contacts_of(states) == {"status_stale"}, "its silence to be noticed")
    states.close()


def _contacts_of(states: Heard) -> set[str]:
    return {"status_stale", "seat_empty"} & set(dict(read_drive_state(states[-1]).halts))


def test_f5_a_speed_that_is_not_a_number_replaces_the_one_before(ros: Harness) -> None:
    from waychair.ros.nodes import bridge_node

    heard = bridge_node.LastMessage(Twist(0.5, 0.0))
    node: Any = SimpleNamespace(_command=heard)
    listening = Input(
        ros.node,
        topics.COMMAND,
        read_twist,
        heard.take,
        lambda reason: bridge_node.BridgeNode._take_invalid_speed(node, reason),
    )
    send = ros.publisher(topics.COMMAND, listening.name)
    for told, kept in ((Twist(0.3, 0.1), True), (Twist(math.nan, 0.0), False), (Twist(0.2, 0.0), True)):
        send(twist(told))
        wanted = (lambda told=told: heard.value == told) if kept else (lambda: math.isnan(heard.value.v))
        ros.spin_until(wanted, f"{told} to be heard")
    ros.node.destroy_subscription(listening.subscription)


@pytest.mark.parametrize(
    ("ticked_ms", "asked_ms", "ticks"),
    [(49, 49, 0), (60, 60, 0), (66, 66, 1), (46, 90, 1), (44, 90, 0)],  # ages of the last tick and request
)
def test_each_request_is_answered_by_one_tick_and_only_missing_ones_by_the_clock(
    ticked_ms: int, asked_ms: int, ticks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from waychair.ros.nodes import bridge_node

    now_ns, made = 10**9, list[int]()
    monkeypatch.setattr(bridge_node.time, "monotonic_ns", lambda: now_ns)
    request = bridge_node.LastMessage(DriveRequest(0), at_ns=now_ns - asked_ms * 10**6)
    node: Any = SimpleNamespace(
        _request=request,
        _localised=bridge_node.Localised(),
        _drive=bridge_node.BridgeDrive(ticked_ns=now_ns - ticked_ms * 10**6),
        _tick=lambda: made.append(now_ns),
    )
    bridge_node.BridgeNode._watch(node)
    assert len(made) == ticks
