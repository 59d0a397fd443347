"""The bridge alone, without a board: levels of help by service and by parameter, and the topic `guard`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.guard import SPOKEN, Unscanned
from waychair.ros import topics
from waychair.ros.messages.guard import read_guard
from waychair.ros.messages.json_text import json_text
from waychair.runtime.measured_motion import MeasuredMotion
from waychair.runtime.rider.guard_points import IN_ODOM, STALE_NS, GuardPoints
from waychair.runtime.rider.guard_view import GuardView
from waychair.runtime.rider.rider_guard import NOTHING_HELD
from waychair.types import FloatArray, HelpLevel, Pose2

if TYPE_CHECKING:
    from tests.ros.harness import Harness, Heard


@dataclass
class Bridge:
    """The process, and its levels."""

    ros: Harness
    heard: Heard

    @property
    def guard(self) -> GuardView:
        """The latest."""
        return read_guard(self.heard[-1])

    def call(self, kind: str, name: str, **request: Any) -> Any:
        from waychair.ros.interface_types import interface_type

        service = interface_type(kind)
        client = self.ros.node.create_client(service, name)
        self.ros.spin_until(client.service_is_ready, name)
        future = client.call_async(service.Request(**request))
        self.ros.spin_until(future.done, f"an answer of {name}")
        self.ros.node.destroy_client(client)
        return future.result()

    def set_level(self, level: str) -> Any:
        """Set the parameter; return the result."""
        from waychair.ros.interface_types import interface_type

        value = interface_type("rcl_interfaces/msg/ParameterValue")(type=4, string_value=level)
        parameter = interface_type("rcl_interfaces/msg/Parameter")(name="help_level", value=value)
        answer = self.call("rcl_interfaces/srv/SetParameters", "bridge/set_parameters", parameters=[parameter])
        return answer.results[0]

    def until(self, level: HelpLevel) -> None:
        self.ros.spin_until(lambda: self.heard and self.guard.level is level, f"the level {level.value}")


@pytest.fixture(scope="module")
def bridge(ros: Harness, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bridge]:
    cable = Path(tmp_path_factory.mktemp("cable"), "none")
    heard = ros.heard(topics.GUARD)
    arguments = ("-p", f"cable:=pty:{cable}", "-p", "help_level:=guide")
    with ros.process("-m", "waychair.ros.nodes.bridge_node", "--ros-args", *arguments):
        ros.spin_until(lambda: heard, "the bridge's level")
        yield Bridge(ros, heard)
    heard.close()


def test_a_level_that_is_set_at_the_start_is_offered_and_does_not_begin(bridge: Bridge) -> None:
    first = read_guard(bridge.heard[0])
    assert (first.level, first.offered, first.caps) == (HelpLevel.INFORM, HelpLevel.GUIDE, None)
    assert first.told == "Last time you chose guide. Choose it again to begin."


def test_the_rider_chooses_by_service_and_the_parameter_follows(bridge: Bridge) -> None:
    answer = bridge.call("waychair_msgs/srv/ChooseLevel", "choose_level", level="guard")
    assert (answer.success, answer.message) == (True, SPOKEN[HelpLevel.GUARD])
    bridge.until(HelpLevel.GUARD)
    assert bridge.guard.waits
    told = bridge.call("rcl_interfaces/srv/GetParameters", "bridge/get_parameters", names=["help_level"])
    assert told.values[0].string_value == "guard"
    wrong = bridge.call("waychair_msgs/srv/ChooseLevel", "choose_level", level="push")
    assert not wrong.success
    assert "inform, guard, guide" in wrong.message
    nothing = bridge.call("std_srvs/srv/Trigger", "override_guard")
    assert (nothing.success, nothing.message) == (False, NOTHING_HELD)


def test_the_parameter_is_set_while_the_node_runs_and_a_wrong_one_refused(bridge: Bridge) -> None:
    assert bridge.set_level("guide").successful
    bridge.until(HelpLevel.GUIDE)
    refused = bridge.set_level("push")
    assert not refused.successful
    assert "inform, guard, guide" in refused.reason
    assert bridge.set_level("inform").successful
    bridge.until(HelpLevel.INFORM)


def test_walls_that_were_seen_on_a_way_without_a_map_are_watched_while_they_are_told(ros: Harness) -> None:
    from waychair.ros.node_settings.bridge import BridgeNodeSettings
    from waychair.ros.nodes.node import ChairNode
    from waychair.ros.nodes.parts.bridge_state import Localised
    from waychair.ros.nodes.parts.help_levels import HelpLevels

    motion = MeasuredMotion(CHAIR_A, Pose2())
    guard = SimpleNamespace(offer=lambda level: None, unscanned=Unscanned(), level=HelpLevel.GUARD)
    base: Any = SimpleNamespace(guard=guard, motion=motion)
    with ros.serving(ChairNode("levels", BridgeNodeSettings, ["help_level"], [])) as node:
        levels = HelpLevels(node, base, HelpLevel.INFORM.value)
        send = ros.publisher(topics.SEEN_WALLS)
        behind = np.array([[-1.0, 0.2]])
        send(json_text(GuardPoints.near(0, IN_ODOM, Unscanned(mapped=behind), Pose2())))

        def watched(later_ns: int = 0) -> FloatArray:
            levels.watch(Localised(), time.monotonic_ns() + later_ns)
            return guard.unscanned.mapped

        ros.spin_until(lambda: len(watched()), "the walls")
        assert watched() == pytest.approx(behind)
        assert len(watched(2 * STALE_NS)) == 0
