"""MQTT for a chair under VDA 5050: topics, last will, and the queue of received messages (extra `[vda5050]`).

Only here paho-mqtt is imported, when a link is opened. Without keys a broker off this computer is refused: who reaches it
could command the chair.
"""

from __future__ import annotations

import queue
import ssl
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waychair.errors import MissingExtra, VdaError
from waychair.files import os_error_text
from waychair.install_advice import install_command
from waychair.runtime.fleet.vda5050 import vda5050_messages as vda
from waychair.runtime.fleet.vda5050.vda5050_robot import MANUFACTURER, VdaChair

if TYPE_CHECKING:
    from paho.mqtt.client import Client

INTERFACE = "uagv"
"""First part of all topics, as the standard proposes."""

INCOMING = ("order", "responses", "instantActions")

STATE_AT_LEAST_EVERY_MS = 30_000
"""ms; the standard's longest time between two states."""

_LOCAL = ("127.0.0.1", "localhost", "::1")
_CONNECT_S = 5.0
_KEEPALIVE_S = 5  # after one and a half times as long the broker sends the last will
_MOST_WAITING = 100  # received messages; more come from a fleet control that went wrong, and are dropped
_TOPICS_QOS = {"connection": 1}  # the standard's: all others are 0
_RETAINED = ("connection", "factsheet")


@dataclass(frozen=True, slots=True)
class BrokerKeys:
    """Files of a certificate authority, and of a chair's certificate and key."""

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class Broker:
    """An MQTT broker."""

    host: str = "127.0.0.1"
    port: int = 1883
    keys: BrokerKeys | None = None


def topic_of(serial_number: str, name: str) -> str:
    """Return a chair's topic."""
    return f"{INTERFACE}/v{vda.MAJOR}/{MANUFACTURER}/{serial_number}/{name}"


class VdaLink:
    """The link between a chair and its fleet control. All methods are for one thread; MQTT has its own."""

    def __init__(self, client: Client, chair: VdaChair) -> None:
        """Use `vda_link`, which opens it."""
        self._client, self._chair = client, chair
        self._heard: queue.Queue[tuple[str, bytes]] = queue.Queue(_MOST_WAITING)
        self._links: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._last: tuple[bytes, int] | None = None
        self.up = False
        self.dropped = 0
        """messages that came faster than they were taken"""

    def heard(self, topic: str, data: bytes) -> None:
        """Keep a message for `step`; called by MQTT's thread."""
        try:
            self._heard.put_nowait((topic.rpartition("/")[2], data[: vda.LARGEST + 1]))
        except queue.Full:
            self.dropped += 1

    def changed(self, up: bool) -> None:
        """Keep in mind that the link came up or went down; called by MQTT's thread."""
        self._links.put(up)

    def step(self, state_of: Callable[[int, int], vda.VdaState], now_ns: int, now_ms: int) -> None:
        """Give the chair all that was heard, let it ask for its zones, then publish its state where it differs from the last, or that is old.

        `state_of(now_ns, now_ms)` returns the state; `now_ns` is the chair's monotonic clock, `now_ms` since 1970.
        """
        while not self._links.empty():
            self.up = self._links.get()
            self._last = None
            if not self.up:
                self._chair.link_lost()
            else:
                self.publish("connection", self._chair.connection(vda.ConnectionState.ONLINE, now_ms))
        with suppress(queue.Empty):
            while True:
                topic, data = self._heard.get_nowait()
                self._chair.receive(topic, data, now_ns)
        self._chair.ask(now_ns)
        if not self.up:
            return
        state = state_of(now_ns, now_ms)
        alike = vda.text_of(state).partition(b'"version"')[2]  # all but number and time
        if self._last is None or alike != self._last[0] or now_ms - self._last[1] >= STATE_AT_LEAST_EVERY_MS:
            self._last = (alike, now_ms)
            self.publish("state", state)

    def publish(self, name: str, message: vda.Header) -> None:
        """Publish a message on a topic of the chair."""
        topic = topic_of(self._chair.serial_number, name)
        self._client.publish(topic, vda.text_of(message), qos=_TOPICS_QOS.get(name, 0), retain=name in _RETAINED)


@contextmanager
def vda_link(chair: VdaChair, broker: Broker, now_ms: int) -> Iterator[VdaLink]:
    """Connect a chair to a broker during the block; the link comes back by itself after a loss.

    At the block's end the chair says that it is offline. If it dies, the broker says that the connection is broken.

    Raises:
        MissingExtra: paho-mqtt is not installed.
        VdaError: the broker cannot be reached, or is off this computer and there are no keys.
    """
    if broker.keys is None and broker.host not in _LOCAL:
        raise VdaError(
            f"the broker at {broker.host} is off this computer: give the chair keys, or use one at 127.0.0.1"
        )
    try:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion
    except ImportError as error:
        raise MissingExtra(f"VDA 5050 needs paho-mqtt: {install_command('vda5050')}") from error
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"{MANUFACTURER}-{chair.serial_number}")
    link = VdaLink(client, chair)
    will = vda.text_of(chair.connection(vda.ConnectionState.CONNECTION_BROKEN, now_ms))
    client.will_set(topic_of(chair.serial_number, "connection"), will, qos=1, retain=True)

    def connected(_client: Client, _data: object, _flags: object, reason: Any, _properties: object) -> None:
        if not reason.is_failure:
            client.subscribe([(topic_of(chair.serial_number, name), 0) for name in INCOMING])
            link.changed(True)

    client.on_connect = connected
    client.on_disconnect = lambda *_: link.changed(False)
    client.on_message = lambda _client, _data, message: link.heard(message.topic, bytes(message.payload))
    client.reconnect_delay_set(1, 5)
    client.connect_timeout = _CONNECT_S
    try:
        if broker.keys is not None:
            client.tls_set(
                str(broker.keys.authority), str(broker.keys.certificate), str(broker.keys.key), ssl.CERT_REQUIRED
            )
        client.connect(broker.host, broker.port, keepalive=_KEEPALIVE_S)
    except OSError as error:
        raise VdaError(
            f"the broker at {broker.host}:{broker.port} cannot be reached: {os_error_text(error)}"
        ) from error
    client.loop_start()
    try:
        yield link
    finally:
        offline = chair.connection(vda.ConnectionState.OFFLINE, now_ms)
        with suppress(RuntimeError, ValueError):  # the broker is gone
            sent = client.publish(topic_of(chair.serial_number, "connection"), vda.text_of(offline), qos=1, retain=True)
            sent.wait_for_publish(1.0)
        client.disconnect()
        client.loop_stop()
