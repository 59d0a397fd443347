"""A chair under VDA 5050 by a real broker on this computer: mosquitto."""

from __future__ import annotations

import json
import queue
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.ports import free_port, wait_until_open
from tests.runtime.fleet.test_vda5050 import HEADER, NOW_MS, WAYS, order, spots, state
from tests.runtime.fleet.vda_fields import faults
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import VdaError
from waychair.runtime.fleet.vda5050.vda5050_link import Broker, VdaLink, topic_of, vda_link
from waychair.runtime.fleet.vda5050.vda5050_robot import ChairMoment, VdaChair
from waychair.types import Pose2

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


class FleetControl:
    """A client of the broker that hears all topics of chair 2."""

    def __init__(self, port: int) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        self.heard: queue.Queue[tuple[str, dict[str, Any]]] = queue.Queue()
        self.client = Client(CallbackAPIVersion.VERSION2)
        self.client.on_connect = lambda client, *_: client.subscribe(topic_of("2", "#"), 1)
        self.client.on_message = lambda _client, _data, message: self.heard.put(
            (message.topic.rpartition("/")[2], json.loads(message.payload))
        )
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()

    def send(self, name: str, data: bytes) -> None:
        """Publish a message to the chair."""
        self.client.publish(topic_of("2", name), data)

    def next(self, name: str) -> dict[str, Any]:
        """Return the next message on a topic; it must be as the standard lists it."""
        while True:
            topic, values = self.heard.get(timeout=30)
            if topic == name:
                assert faults(name, values) == []
                return values


@pytest.fixture
def broker_port(tmp_path: Path) -> int:
    """Port for a broker; skips without mosquitto."""
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    port = free_port()
    (tmp_path / "broker.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    return port


@contextmanager
def broker(folder: Path, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """Run mosquitto during the block."""
    assert MOSQUITTO is not None
    process = subprocess.Popen([MOSQUITTO, "-c", str(folder / "broker.conf")], stderr=subprocess.DEVNULL)
    try:
        wait_until_open(port)
        yield process
    finally:
        process.kill()
        process.wait()


def stepped(link: VdaLink, chair: VdaChair, until: Any) -> None:
    """Step the link until a condition holds, half a minute at most."""
    moment = ChairMoment(Pose2(0.0, 0.0, 0.0))
    ends = time.monotonic() + 30
    while not until():
        assert time.monotonic() < ends
        link.step(lambda now_ns, now_ms: chair.state(moment, now_ns, now_ms), 0, NOW_MS)
        time.sleep(0.01)


def test_orders_and_grants_come_in_and_state_connection_and_factsheet_go_out(tmp_path: Path, broker_port: int) -> None:
    chair = VdaChair(WAYS, "2", "P")
    with broker(tmp_path, broker_port) as process:
        control = FleetControl(broker_port)
        with vda_link(chair, Broker(port=broker_port), NOW_MS) as link:
            stepped(link, chair, lambda: link.up)
            link.publish("factsheet", chair.factsheet(CHAIR_A, 0.8, 0.6, NOW_MS))
            assert control.next("connection")["connectionState"] == "ONLINE"
            assert control.next("state")["lastNodeId"] == "P"
            assert control.next("factsheet")["typeSpecification"]["seriesName"] == "waychair A"
            control.send("order", order("P P-a a", 3))
            stepped(link, chair, lambda: chair.goal == "a")
            (request,) = control.next("state")["zoneRequests"]
            grant = {"requestId": request["requestId"], "grantType": "GRANTED"}
            control.send("responses", json.dumps({**HEADER, "responses": [grant]}).encode())
            stepped(link, chair, lambda: spots(chair) == ["P", "P-a", "a"])
            assert control.next("state")["zoneRequests"][0]["requestStatus"] == "GRANTED"
            before = control.heard.qsize()
            stepped(link, chair, iter([False] * 5 + [True]).__next__)
            assert control.heard.qsize() == before  # a state that does not change is not sent again
            process.send_signal(signal.SIGKILL)
            process.wait()
            stepped(link, chair, lambda: not link.up)
            assert spots(chair) == ["P"]  # nobody could take the grant back any more
            with broker(tmp_path, broker_port):
                control = FleetControl(broker_port)
                stepped(link, chair, lambda: link.up)
                assert control.next("connection")["connectionState"] == "ONLINE"
                assert control.next("state")["orderId"] == "o1"
                link.publish("state", chair.state(ChairMoment(None), 0, NOW_MS))
                # the chair's process dies: the broker speaks for it
                sock = link._client.socket()
                assert sock is not None
                link._client.loop_stop()
                sock.close()
                assert control.next("connection")["connectionState"] == "CONNECTION_BROKEN"
    assert state(chair)["orderId"] == "o1"


def test_the_chair_says_that_it_is_offline_when_its_link_ends(tmp_path: Path, broker_port: int) -> None:
    chair = VdaChair(WAYS, "2", "P")
    with broker(tmp_path, broker_port):
        control = FleetControl(broker_port)
        with vda_link(chair, Broker(port=broker_port), NOW_MS) as link:
            stepped(link, chair, lambda: link.up)
            assert control.next("connection")["connectionState"] == "ONLINE"
        assert control.next("connection")["connectionState"] == "OFFLINE"


def test_a_broker_that_is_not_there_or_off_this_computer_without_keys_is_refused(broker_port: int) -> None:
    chair = VdaChair(WAYS, "2", "P")
    with (
        pytest.raises(VdaError, match=f"the broker at 127.0.0.1:{broker_port} cannot be reached: "),
        vda_link(chair, Broker(port=broker_port), NOW_MS),
    ):
        pass
    with (
        pytest.raises(VdaError, match="off this computer: give the chair keys"),
        vda_link(chair, Broker("broker.example"), NOW_MS),
    ):
        pass
