"""Advice by ROS reaches the glove's program, and the glove's state a page."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.ros.realtime import ALONE
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import MessageError
from waychair.firmware_bridge.glove.program import LiveGlove, glove_program
from waychair.ros import topics
from waychair.ros.messages.cells import signal
from waychair.ros.messages.haptics import advice, haptic_state, read_advice, read_haptic_state
from waychair.ros.messages.wire import deserialised, serialised
from waychair.ros.stack import Stack, processes
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.types import HelpLevel

if TYPE_CHECKING:
    from tests.ros.harness import Harness

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


@ALONE
def test_the_node_plays_advice_on_a_live_glove_and_tells_a_page_of_it(ros: Harness) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.nodes.glove_node import GloveNode

    heard = ros.heard(topics.HAPTIC_STATE)
    with LiveGlove(glove_program()) as glove:
        levels: set[int] = set()
        done = threading.Event()

        def feel() -> None:
            while not done.is_set():
                for _, motors in glove.records(0.1):
                    levels.update(k for k, level in enumerate(motors) if level)

        thread = threading.Thread(target=feel)
        thread.start()
        try:
            arguments = ["--ros-args", "-p", f"port:=pty:{glove.path}"]
            with ros.serving(GloveNode(arguments)):
                topic = topics.ADVICE
                sender = ros.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))

                def send() -> None:
                    now_ns = ros.node.get_clock().now().nanoseconds
                    sender.publish(serialised(advice(now_ns, Advice(Symbol.FORWARD, 1, now_ns + 10**9))))

                def told() -> bool:
                    states = [read_haptic_state(each) for each in heard]
                    return any(each.symbol == "forward" and not each.unfelt for each in states) and levels == {7, 4, 1}

                ros.spin_until(told, "the glove", send)
        finally:
            done.set()
            thread.join()
