"""A chair of `waychair up --fleet` waits for another one at its goal, says so on its page, and goes once that one has gone."""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.ros.realtime import ALONE
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.traffic.mapped_floor import mapped_floor_graph
from waychair.maps.traffic.traffic_files import write_traffic
from waychair.simulation.plan.world import load_world

for needed in ("rclpy", "fastapi", "zenoh"):
    if importlib.util.find_spec(needed) is None:
        pytest.skip(f"{needed} is not installed", allow_module_level=True)

from evaluation.runs.live_stack import LiveStack

from tests.ports import free_port
from tests.ros.test_page import Page, sets_off
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.fleet_file import FleetFile
from waychair.runtime.fleet.fleet_member import FleetMember
from waychair.runtime.fleet.network.peer_process import clock_ns, fleet_of, new_boot
from waychair.runtime.fleet.network.zenoh_transport import ZenohTransport
from waychair.trials.fleet.fleet_on_lines import ChairOnLine

if TYPE_CHECKING:
    from tests.ros.harness import Harness

pytestmark = [ALONE, pytest.mark.nightly]

WORLD = load_world("small_clinic").without_people()
PLACES = {place.name: place for place in WORLD.places}
GOAL, AWAY = "reception", "bath"
DRIVE_S = 240.0


@contextmanager
def other_chair(file: FleetFile) -> Iterator[ChairOnLine]:
    """Another chair of the fleet that stands at the goal; it drives along its chains without a simulator."""
    fleet, ended = fleet_of(file), threading.Event()
    driver = ChainDriver(fleet.ways, file.number, CHAIR_A, PLACES)
    with closing(ZenohTransport(file, fleet.building)) as transport:
        chair = ChairOnLine(
            FleetMember(fleet, file.number, new_boot(), driver, GOAL, transport), driver, PLACES[GOAL].pose
        )

        def live() -> None:
            while not ended.wait(0.1):
                chair.step(clock_ns())

        thread = threading.Thread(target=live)
        thread.start()
        try:
            yield chair
        finally:
            ended.set()
            thread.join()


def waits(page: Page) -> str:
    """Return why the chair waits for others, as its page shows it."""
    others = page.view["others"]
    return "" if others is None else str(others["waits"])


def test_a_goal_at_which_another_chair_stands_is_reached_once_it_has_gone(ros: Harness, tmp_path: Path) -> None:
    graph = tmp_path / "clinic.traffic"
    write_traffic(
        graph, mapped_floor_graph(WORLD.grid, list(PLACES.values()), name="clinic", chair_width=CHAIR_A.width)
    )
    ports = {number: free_port() for number in (1, 2)}
    ends = {number: f"tcp/127.0.0.1:{port}" for number, port in ports.items()}
    fleet = tmp_path / "fleet1.yaml"
    fleet.write_text(
        f"building: {graph}\nnumber: 1\nchairs: [1, 2]\nlisten: {ends[1]}\nendpoints: [{ends[2]}]\n", encoding="utf-8"
    )
    port = free_port()
    options = ("--no-camera", "--no-people", "--page", "--page-port", str(port), "--fleet", str(fleet))
    other = FleetFile(str(graph), 2, (1, 2), endpoints=(ends[1],), listen=ends[2])
    with (
        other_chair(other) as second,
        LiveStack(tmp_path / "up", ros.domain, *options) as stack,
        Page(port, "tests") as page,
    ):
        stack.until(lambda: page.view.get("localisation") == "ok", "the page")
        stack.until(lambda: page.view["others"] is not None and page.view["others"]["chairs"], "the other chair")
        sets_off(stack, page, lambda: waits(page) == f"Waits for chair 2 to leave {GOAL}.", place=GOAL)
        stack.spin(3.0)
        assert stack.really is not None
        assert abs(stack.really.twist.v) < 0.01
        second.goal = AWAY
        second.member.want(AWAY, clock_ns())
        stack.until(lambda: second.driver.arrived_at(AWAY), "the other chair to be away", DRIVE_S)
        sets_off(stack, page, lambda: page.view["last"] == f"Arrived at {GOAL}.", place=GOAL)
        assert not waits(page)
        really, place = stack.true_pose(), PLACES[GOAL].pose
        assert abs(really.x - place.x) + abs(really.y - place.y) < 0.4
