"""Advice by ROS reaches the glove's program, and the glove's state a page."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.ros.realtime import ALONE
from tests.runtime.haptics.guided_rider import DESK, START, room
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.commands import Signal, SignalKind
from waychair.control.haptics.next_door import DoorSide, no_door
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import MessageError
from waychair.firmware_bridge.glove.program import LiveGlove, glove_program
from waychair.maps.drawn.places import save_places
from waychair.recordings.bags.ros_messages import ODOM_FRAME, laser_scan, odometry
from waychair.ros import topics
from waychair.ros.messages.cells import perception, signal
from waychair.ros.messages.chair import localisation
from waychair.ros.messages.floor import Floor, floor
from waychair.ros.messages.guard import guard_message
from waychair.ros.messages.haptics import advice, haptic_state, read_advice, read_haptic_state
from waychair.ros.messages.json_text import read_json_text
from waychair.ros.messages.maps import occupancy_grid
from waychair.ros.messages.wire import deserialised, serialised
from waychair.ros.stack import Stack, processes
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.pages.perception_view import DoorwayView, PerceptionView, SectorsView
from waychair.runtime.rider.guard_points import IN_ODOM, GuardPoints
from waychair.runtime.rider.guard_view import GuardView
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import HelpLevel, Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

WIDE = (1.0, 1.0, 1.0, 1.0)
"""Caps of a board that guards and holds nothing."""

OBSTACLE = Advice(Symbol.OBSTACLE_AT, 7, 1_500_000_002, math.radians(90.0), "a table")


def test_advice_and_the_gloves_state_arrive_unchanged_over_the_wire() -> None:
    sent = advice(1_000_000_001, OBSTACLE)
    back = deserialised(serialised(sent), "waychair_msgs/msg/Advice")
    assert read_advice(back) == OBSTACLE
    assert back.header.stamp.nanosec == 1
    forward = Advice(Symbol.FORWARD, 8, 2_000_000_000)
    assert read_advice(advice(0, forward)) == forward
    state = HapticState(5, HelpLevel.GUIDE, symbol="forward", count=3, play=(((7,), 150, 0),), notices=("hot",))
    assert read_haptic_state(haptic_state(state)) == state


def test_an_unknown_symbol_or_direction_is_refused_by_its_name() -> None:
    strange = advice(0, OBSTACLE)
    strange.symbol = "jump"
    with pytest.raises(MessageError, match="there is no symbol 'jump'"):
        read_advice(strange)
    strange.symbol, strange.direction = "obstacle_at", math.nan
    with pytest.raises(MessageError, match="the direction of an obstacle"):
        read_advice(strange)
    with pytest.raises(MessageError, match="about the glove"):
        read_haptic_state(signal("forward"))


def test_the_stack_starts_the_glove_where_a_port_is_given_and_does_not_end_with_it(tmp_path: Path) -> None:
    assert "glove" not in [each.name for each in processes(Stack(tmp_path, cable="tcp:1.2.3.4:5", mapping=True))]
    stack = Stack(tmp_path, cable="tcp:1.2.3.4:5", mapping=True, settings={"glove": {"port": "/dev/ttyUSB1"}})
    glove = next(each for each in processes(stack) if each.name == "glove")
    assert glove.module == "waychair.ros.nodes.glove_node"
    assert not glove.vital


@contextlib.contextmanager
def felt_glove() -> Iterator[tuple[str, set[int]]]:
    """A glove's program on a pseudo-terminal: its port, and the motors that have vibrated so far."""
    levels: set[int] = set()
    done = threading.Event()
    with LiveGlove(glove_program()) as glove:

        def feel() -> None:
            while not done.is_set():
                for _, motors in glove.records(0.1):
                    levels.update(k for k, level in enumerate(motors) if level)

        thread = threading.Thread(target=feel)
        thread.start()
        try:
            yield f"pty:{glove.path}", levels
        finally:
            done.set()
            thread.join()


@ALONE
def test_the_node_plays_advice_on_a_live_glove_and_tells_a_page_of_it(ros: Harness) -> None:
    from waychair.ros.nodes.glove_node import GloveNode

    heard = ros.heard(topics.HAPTIC_STATE)
    with felt_glove() as (port, levels), ros.serving(GloveNode(["--ros-args", "-p", f"port:={port}"])):
        sender = ros.publisher(topics.ADVICE)

        def send() -> None:
            now_ns = ros.node.get_clock().now().nanoseconds
            sender(advice(now_ns, Advice(Symbol.FORWARD, 1, now_ns + 10**9)))

        def told() -> bool:
            states = [read_haptic_state(each) for each in heard]
            return any(each.symbol == "forward" and not each.unfelt for each in states) and levels == {7, 4, 1}

        ros.spin_until(told, "the glove", send)


@ALONE
def test_a_rider_is_led_to_a_place_of_the_map_and_feels_the_first_step(ros: Harness, tmp_path: Path) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.nodes.glove_node import GloveNode
    from waychair.ros.nodes.parts.led_rider import NO_MAP

    save_places(tmp_path, {"desk": DESK})
    heard = ros.heard(topics.HAPTIC_STATE)
    with felt_glove() as (port, levels), ros.serving(GloveNode(["--ros-args", "-p", f"port:={port}"])):
        grid, told_floor = ros.publisher(topics.MAP), ros.publisher(topics.FLOOR)
        moved, located = ros.publisher(topics.ODOMETRY), ros.publisher(topics.LOCALISATION)
        told_guard, level = ros.publisher(topics.GUARD), HelpLevel.GUARD

        def stand() -> None:
            now_ns = ros.node.get_clock().now().nanoseconds
            told_guard(guard_message(now_ns, GuardView(level, caps=WIDE)))
            moved(odometry(now_ns, ODOM_FRAME, Pose2(), Twist()))
            located(localisation(now_ns, Localisation(START, START, 1.0, LocalisationState.OK, 1.0), "", 5))

        kind = interface_type("waychair_msgs/srv/Lead")
        client = ros.node.create_client(kind, "haptics/lead")
        ros.spin_until(client.service_is_ready, "haptics/lead")

        def asked(place: str) -> tuple[bool, str]:
            future = client.call_async(kind.Request(place=place))
            ros.spin_until(future.done, "an answer", stand)
            return future.result().success, future.result().message

        assert asked("desk") == (False, NO_MAP)
        now_ns = ros.node.get_clock().now().nanoseconds
        grid(occupancy_grid(now_ns, room(), loaded_ns=5))
        told_floor(floor(Floor(now_ns, str(tmp_path), 5)))
        ros.spin_until(lambda: asked("ghost")[1] != NO_MAP, "the map")
        assert "did you mean desk?" in asked("ghost")[1]
        assert asked("desk") == (True, "You are led to desk.")

        assert not any(read_haptic_state(each).goal for each in heard)  # the bridge has not begun the level guide yet
        level = HelpLevel.GUIDE

        def led() -> bool:
            states = [read_haptic_state(each) for each in heard]
            return levels == {7, 4, 1} and any(
                (each.goal, each.symbol, each.step, each.unfelt) == ("desk", "forward", "straight 4.0 m", "")
                for each in states
            )

        ros.spin_until(led, "the first step", stand)


BEHIND = 1.2
"""m from the lidar to a wall behind the chair."""


@ALONE
def test_a_rider_is_led_through_the_next_door_without_a_map(ros: Harness) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.nodes.glove_node import GloveNode
    from waychair.ros.nodes.parts.led_rider import NO_CELLS

    heard = ros.heard(topics.HAPTIC_STATE)
    walls = ros.heard(topics.SEEN_WALLS)
    ranges = np.full(720, 4.5, np.float32)
    ranges[-40:] = BEHIND  # a wall behind on the left
    ahead = DoorwayView(1, 3.0, 0.0, 0.0, 0.9, 0.9, "open", True, "Doorway 1: open, wide enough.")
    with felt_glove() as (port, levels), ros.serving(GloveNode(["--ros-args", "-p", f"port:={port}"])):
        moved, seen, told_cells = (ros.publisher(each) for each in (topics.ODOMETRY, topics.SCAN, topics.PERCEPTION))
        told_guard, perceives = ros.publisher(topics.GUARD), False
        warned: Signal | None = None

        def stand() -> None:
            now_ns = ros.node.get_clock().now().nanoseconds
            told_guard(guard_message(now_ns, GuardView(HelpLevel.GUIDE, caps=WIDE)))
            moved(odometry(now_ns, ODOM_FRAME, START, Twist(0.0 if warned is None else 0.3)))
            seen(laser_scan(Scan(now_ns, ranges, -math.pi, math.tau / 720, range_max=10.0)))
            if perceives:
                view = PerceptionView(now_ns, "", (), (), SectorsView(8, (), True, ""), (ahead,), told=warned)
                told_cells(perception(view))

        kind = interface_type("waychair_msgs/srv/LeadThrough")
        client = ros.node.create_client(kind, "haptics/lead_through")
        ros.spin_until(client.service_is_ready, "haptics/lead_through")

        def answer(side: str) -> tuple[bool, str]:
            future = client.call_async(kind.Request(side=side))
            ros.spin_until(future.done, "an answer", stand)
            return future.result().success, future.result().message

        assert answer("up") == (False, "there is no side 'up': take left, ahead or right")
        assert answer("ahead") == (False, NO_CELLS)
        perceives = True
        ros.spin_until(lambda: answer("left") == (False, no_door(DoorSide.LEFT)), "the doorways")
        assert answer("ahead") == (True, "You are led through the door ahead.")

        def led() -> bool:
            states = [read_haptic_state(each) for each in heard]
            return levels == {7, 4, 1} and any(
                (each.goal, each.symbol, each.unfelt) == ("the door ahead", "forward", "") for each in states
            )

        ros.spin_until(led, "the first step", stand)
        told = read_json_text(walls[-1], GuardPoints, "walls")
        assert told.revision == IN_ODOM
        points = told.unscanned().seen_from(START @ CHAIR_A.base_from_laser).mapped
        assert len(points) > 5
        assert np.hypot(*points.T) == pytest.approx(BEHIND, abs=0.1)
        assert (points[:, 0] < -0.9 * BEHIND).all()
        warned = Signal(SignalKind.WARNING, "a wall ahead")
        ros.spin_until(
            lambda: any((each.symbol, each.unfelt) == ("warning", "") for each in map(read_haptic_state, heard)),
            "the cells' warning",
            stand,
        )
