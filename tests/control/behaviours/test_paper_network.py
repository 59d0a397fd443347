"""The paper's network as a whole: its rules as a table, its camera, its doorway, and bad inputs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from evaluation.behaviours.navigation_table import TableRun, expected, found, list_cases, obstacle_cases

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.cell import Cell
from waychair.control.behaviours.cell_network import Network, wire
from waychair.control.behaviours.commands import FreeKind, signal_words
from waychair.control.behaviours.default import default_network
from waychair.control.behaviours.doorway import FrameCandidate, FramesSeen, OdometryPose
from waychair.control.behaviours.paper import SENSORS, PaperSettings, paper_network
from waychair.control.behaviours.paper_settings import CameraLimits, DoorLimits, ObstacleLimits
from waychair.control.behaviours.range_finder import CameraAim, LaserLine, LookRequest
from waychair.control.behaviours.runtime import Innervation, Runtime
from waychair.control.behaviours.sonar import SonarPacket, packet_from_ranges
from waychair.errors import ConfigError, WiringError

INF, TICK_NS = math.inf, 50_000_000


def test_every_outcome_of_the_navigation_command_manager_is_as_the_table_says() -> None:
    run = TableRun()
    cases = [*list_cases()][::7] + [*obstacle_cases()][::2003]
    for case in cases:
        assert found(run.signal(case)) == expected(case), case


class Rider:
    """The paper's network with a camera that obeys, ticked at 20 Hz."""

    def __init__(self) -> None:
        self.runtime, self.tick, self.aim = Runtime(paper_network()), 0, CameraAim(0.0, 0.0, True)
        self.wall_m, self.clients = 3.0, list[str]()

    def step(self, ranges: Any = (INF,) * 8, **heard: Any) -> Innervation:
        self.tick += 1
        packet = ranges if isinstance(ranges, SonarPacket) else packet_from_ranges(ranges)
        columns = np.arange(0.0, 640.0, 20.0)
        rows = np.full(len(columns), 240.0 + 600.0 * 0.10 / self.wall_m)
        given: dict[str, Any] = {
            "sonar packet": packet,
            "camera aim": self.aim,
            "laser line in the picture": LaserLine(columns, rows, self.aim),
            "odometry": OdometryPose(0.0, 0.0, 0.0),
            **{name.replace("_", " "): value for name, value in heard.items()},
        }
        sent = {name: value for name, value in given.items() if value is not None}
        done = self.runtime.innervate(self.tick * TICK_NS, sent)
        order = done.actions.get("pan/tilt servos")
        if order is not None:
            self.aim = CameraAim(order[0], order[1], settled=order[0] == self.aim.pan)
        command = done.ports["grant"].eo
        self.clients.append(command.client if command is not None else "")
        return done

    def ticks(self, count: int, **heard: Any) -> None:
        for _ in range(count):
            self.step(**heard)


def words(done: Innervation) -> str:
    return signal_words(done.ports["Perceptual navigation"].eo)


def test_free_space_looks_by_the_camera_where_no_sonar_looks_and_offers_what_it_found() -> None:
    rider = Rider()
    seen = [rider.step().ports["Free-space finding"].eo.command for _ in range(14)]
    assert len(seen[0].orientations) == 6
    assert len(seen[-1].orientations) == 8
    assert all(command.kind is FreeKind.LIST for command in seen)
    assert words(rider.step((INF, 0.3, 0.3, 0.3, INF, INF, INF, INF))) == "go front-left"


def test_a_look_into_a_near_wall_leaves_the_sector_blocked() -> None:
    rider = Rider()
    rider.wall_m = 0.3
    seen = [rider.step().ports["Free-space finding"].eo.command for _ in range(14)]
    assert len(seen[-1].orientations) == 6


FRAME = FramesSeen((FrameCandidate(0.2, -0.2, 0.9),))


def test_while_the_doorway_has_the_camera_free_space_is_inhibited_and_gives_the_null_code() -> None:
    rider = Rider()
    rider.step()
    done = rider.step(door_wanted=True, frames_in_the_picture=FRAME)
    assert done.ports["Door validation"].ab
    assert done.ports["grant"].eo.client == "Range finder"
    assert not done.ports["Free-space finding"].ab
    assert done.ports["Free-space finding"].eo.command.kind is FreeKind.NULL
    over = rider.step(door_wanted=False)
    assert over.ports["Free-space finding"].ab
    assert over.ports["Free-space finding"].eo.command.kind is FreeKind.LIST


def door_line(aim: CameraAim) -> LaserLine:
    """Return the line on a wall 2.6 m ahead of the drive axle with a door of 0.9 m, 2 m deep, camera 0.4 m ahead."""
    columns = np.arange(60.0, 580.0, 4.0)
    aside = np.abs(columns - 320.0) / 600.0 * 2.2
    return LaserLine(columns, 240.0 + 60.0 / np.where(aside > 0.45, 2.2, 4.2), aim)


def test_a_door_is_found_validated_tracked_and_the_rider_led_to_it() -> None:
    rider = Rider()
    edge = math.atan2(0.45, 2.6)
    frames = FramesSeen((FrameCandidate(edge, -edge, 0.9),))
    for _ in range(3):
        done = rider.step(
            door_wanted=True, frames_in_the_picture=frames, laser_line_in_the_picture=door_line(rider.aim)
        )
    door = done.ports["Object tracker"].eo.door
    assert door.middle == pytest.approx((2.6, 0.0), abs=0.05)
    assert door.width == pytest.approx(0.9, abs=0.08)
    assert done.ports["grant"].eo.client == "Object tracker"
    assert words(done) == "go forward"
    assert 0.75 + CHAIR_A.front < 2.6


@pytest.mark.parametrize("packet", [SonarPacket(b""), SonarPacket(packet_from_ranges([1.0] * 8).data[:-3])])
def test_a_packet_cut_short_is_named_and_nothing_is_free_by_the_sonars(packet: SonarPacket) -> None:
    rider = Rider()
    rider.step()
    done = rider.step(packet)
    assert "cut short" in done.faults()["decode_packet"]
    assert done.ports["Free-space finding"].eo.command.kind is FreeKind.NULL
    assert words(done) == "stop the chair: no sonar is heard"
    assert not rider.step().faults()


def test_sonars_that_fall_silent_are_a_stop_after_half_a_second() -> None:
    rider = Rider()
    rider.step()
    said = []
    for _ in range(12):
        rider.tick += 1
        said.append(words(rider.runtime.innervate(rider.tick * TICK_NS)))
    assert said[9] != said[10] == "stop the chair: no sonar is heard"


def test_a_dark_camera_and_a_stuck_pan_never_make_a_sector_free() -> None:
    for stuck in (CameraAim(1.0, 0.0, True), None):
        rider = Rider()
        for _ in range(60):
            done = rider.step(camera_aim=stuck, laser_line_in_the_picture=None)
            assert len(done.ports["Free-space finding"].eo.command.orientations) <= 6
        assert done.faults() == {}


# Two that want one camera, and settings that contradict each other --------------------------------------------------


def orders_the_camera() -> LookRequest:
    return LookRequest(1.0)


def test_two_networks_that_want_one_camera_are_refused_with_both_cells_and_the_effector() -> None:
    other = Cell("other grant", None, {"pan/tilt servos": orders_the_camera})
    both = Network("both", [paper_network().root, Network("other manager", [other])])
    with pytest.raises(
        WiringError, match="grant and other grant both write the effector pan/tilt servos: leave it to one"
    ):
        wire(both, SENSORS)


def test_a_client_that_lost_the_camera_asks_again_and_gets_it_once_it_is_free() -> None:
    rider = Rider()
    rider.ticks(60, frames_in_the_picture=FramesSeen((FrameCandidate(0.15, -0.15, 0.9),)), door_wanted=True)
    assert "Way finder" not in rider.clients[-20:]
    rider.ticks(60, door_wanted=False)
    assert "Way finder" in rider.clients[-60:]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: DoorLimits(zone=0.8), "zone = 0.8 m reaches to the wall"),
        (lambda: PaperSettings(camera=CameraLimits(aimed=0.1)), "camera aimed = 0.1 rad is not below doors jamb"),
        (
            lambda: default_network(PaperSettings(obstacles=ObstacleLimits(stale=0.1))),
            "stale = 0.1 s is shorter than two",
        ),
    ],
)
def test_settings_that_contradict_each_other_are_refused_by_name(make: Any, named: str) -> None:
    with pytest.raises(ConfigError, match=named) as refused:
        make()
    assert "\n" not in str(refused.value)
