"""Peers over Zenoh: without a server, on this computer only unless keys are there. The only file that imports zenoh.

A message of a kind from one peer to another goes to `waychair/<building>/<kind>/<from>/<to>`, `to` being `all` for
everybody. Access control lets a certificate's name put below its own `<from>` only, so that nobody speaks for others.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from waychair.errors import FleetError, MissingExtra
from waychair.install_advice import install_command
from waychair.runtime.fleet.fleet_file import FleetFile, open_to_lan
from waychair.runtime.fleet.network.fleet_keys import KeyFiles, checked_keys

if TYPE_CHECKING:
    import zenoh

LEASE_MS = 1_000
"""ms without a sign of life after which a link counts as gone; by default Zenoh notices after ten seconds."""

MOST_WAITING = 4_000
"""Messages that wait to be read; of more, the oldest are lost."""

LARGEST = 65_536
"""bytes of a message that is taken in at all."""

_THREADS = ("ZENOH_RUNTIME", "(rx: (worker_threads: 1))")
"""Zenoh's threads, unless the owner of the computer sets them: small messages come in on one, as two would wake each other (30 peers
on two cores: 1.08 cores, and 1.16 by default). With one thread for everything it would be 0.86, but then a router of Zenoh 1.10.2
let nobody in any more after some of its programs were killed.
"""

_EVERYBODY = "all"
_URGENT = frozenset({"request", "answer"})
_ASIDE = frozenset({"told", "given"})
"""Kinds of messages beside the peers' own, for staff (`desk_messages`)."""

ROOT = "waychair"

_LOCAL, _ALIVE = "waychair-here", "waychair-alive"
"""Beginnings of the keys of `LocalBus`, which no fleet's network has."""


def zenoh_settings(
    mode: str,
    listen: Sequence[str],
    connect: Sequence[str],
    keys: KeyFiles | None = None,
    names: Sequence[str] = (),
) -> dict[str, Any]:
    """Return Zenoh's configuration by its own paths: no multicast, gossip, short leases, no large messages of peers, and with
    keys mutual TLS.

    With keys, only certificates of these `names` are heard, each below its own name. A peer looks for the others for ever, beside
    its work; a client has to find its router at once.
    """
    found: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/exit_on_failure": False,
        "connect/timeout_ms": -1 if mode != "client" else 3_000,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        "low_pass_filter": [
            {
                "id": "large",
                "flows": ["ingress"],
                "messages": ["put", "delete", "query", "reply"],
                "key_exprs": [f"{ROOT}/**"],
                "size_limit": LARGEST,
            }
        ],
    }
    if keys is None:
        return found
    found["transport/link/tls"] = {
        "root_ca_certificate": str(keys.authority),
        "listen_certificate": str(keys.certificate),
        "listen_private_key": str(keys.key),
        "connect_certificate": str(keys.certificate),
        "connect_private_key": str(keys.key),
        "enable_mtls": True,
        "verify_name_on_connect": False,  # certificates name chairs, not computers
        "close_link_on_expiration": True,
    }
    found["transport/link/protocols"] = ["tls"]
    found["access_control"] = access_control(names)
    return found


def access_control(names: Sequence[str]) -> dict[str, Any]:
    """Return the rules by which each named certificate puts below its own name only; all others are shut out."""
    hear = ["declare_subscriber", "liveliness_query", "declare_liveliness_subscriber", "query", "reply"]
    speak = ["put", "delete", "liveliness_token"]
    rules: list[dict[str, Any]] = [
        {
            "id": "listen",
            "messages": hear,
            "flows": ["ingress", "egress"],
            "permission": "allow",
            "key_exprs": [f"{ROOT}/**"],
        },
        {"id": "send", "messages": speak, "flows": ["egress"], "permission": "allow", "key_exprs": [f"{ROOT}/**"]},
    ]
    rules += [
        {
            "id": f"from {name}",
            "messages": speak,
            "flows": ["ingress"],
            "permission": "allow",
            "key_exprs": [f"{ROOT}/*/*/{name}/**"],
        }
        for name in names
    ]
    subjects = [{"id": name, "cert_common_names": [name]} for name in names]
    policies = [{"rules": ["listen", "send", f"from {name}"], "subjects": [name]} for name in names]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


class _Inbox:
    """Messages of peers until they are fetched. Those to everybody are many, and wake no thread of Python when they come.

    `numbers` of the fleet's peers by their names; messages of others are not taken in.
    """

    def __init__(self, session: zenoh.Session, fleet: FleetFile, building: str) -> None:
        import zenoh

        self.numbers = {fleet.name(number): number for number in (*fleet.chairs, *fleet.voters)}
        self._waiting = session.declare_subscriber(
            f"{ROOT}/{building}/*/*/{_EVERYBODY}", zenoh.handlers.RingChannel(MOST_WAITING)
        )
        self._alone: deque[tuple[int, bytes]] = deque(maxlen=MOST_WAITING)
        self._aside: deque[tuple[int, bytes]] = deque(maxlen=MOST_WAITING)

    def put(self, sample: zenoh.Sample) -> str:
        """Put in a message to this peer alone, in any thread; return its kind, empty if it is not taken in."""
        return self._sort(sample, self._alone)

    def fetch(self) -> list[tuple[int, bytes]]:
        """Return the peers' messages since the last call: those to everybody first, as a Request counts after its State only."""
        import zenoh

        found: deque[tuple[int, bytes]] = deque()
        with contextlib.suppress(zenoh.ZError):  # the session was closed
            for _ in range(MOST_WAITING):  # so that a flood does not keep this call from ending
                sample = self._waiting.try_recv()
                if sample is None:
                    break
                self._sort(sample, found)
        return [*found, *(self._alone.popleft() for _ in range(len(self._alone)))]

    def fetch_aside(self) -> list[tuple[int, bytes]]:
        """Return the messages beside the peers' own; those to everybody are among them once `fetch` has met them."""
        return [self._aside.popleft() for _ in range(len(self._aside))]

    def _sort(self, sample: zenoh.Sample, peers: deque[tuple[int, bytes]]) -> str:
        _, _, kind, name, _ = str(sample.key_expr).split("/")
        number = self.numbers.get(name)
        if number is None:
            return ""
        (self._aside if kind in _ASIDE else peers).append((number, sample.payload.to_bytes()))
        return kind


class ZenohTransport:
    """A peer's end of a Zenoh network. Messages wait in its inbox until `received` fetches them.

    `is_urgent`: a Request or an Answer has come since the last `received`.
    """

    def __init__(
        self,
        fleet: FleetFile,
        building: str,
        lan: bool = False,
        mode: str = "peer",
    ) -> None:
        """Join the network of a fleet.

        Raises:
            FleetError: the endpoint is taken, or an endpoint or key is wrong.
            MissingExtra: the extra [fleet] is not installed.
        """
        own_name = fleet.name(fleet.number)
        self._base, self._own = f"{ROOT}/{building}", own_name
        self._urgent = threading.Event()
        self.is_urgent = False
        self._session = open_session(fleet, lan, mode)
        self._inbox = _Inbox(self._session, fleet, building)
        self._session.declare_subscriber(f"{self._base}/*/*/{own_name}", self._take)
        self._token = self._session.liveliness().declare_token(f"{self._base}/alive/{own_name}/{_EVERYBODY}")
        self._publishers: dict[tuple[str, str], zenoh.Publisher] = {}

    def send(self, to: int | None, kind: str, data: bytes) -> None:
        """Send bytes to a peer, or to all others; it never waits."""
        target = (
            _EVERYBODY
            if to is None
            else next((name for name, number in self._inbox.numbers.items() if number == to), "")
        )
        if not target:
            return
        key = (kind, target)
        if key not in self._publishers:
            import zenoh

            self._publishers[key] = self._session.declare_publisher(
                f"{self._base}/{kind}/{self._own}/{target}",
                express=True,
                congestion_control=zenoh.CongestionControl.DROP,  # peers repeat what is not answered, and never wait
                priority=zenoh.Priority.REAL_TIME,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        self._publishers[key].put(data)

    def received(self) -> list[tuple[int, bytes]]:
        """Return the messages since the last call, with the number under which each sender was let in."""
        self.is_urgent = False
        return self._inbox.fetch()

    def received_aside(self) -> list[tuple[int, bytes]]:
        """Return the messages beside the peers' own that have come since the last call, with the numbers of the senders."""
        return self._inbox.fetch_aside()

    def wait(self, seconds: float) -> None:
        """Return after some seconds, or at once when a Request or an Answer has come."""
        self._urgent.wait(seconds)
        self._urgent.clear()

    def alive(self) -> frozenset[int]:
        """Return the numbers of the peers whose links are up; a hint only, the age of their States decides."""
        replies = self._session.liveliness().get(f"{self._base}/alive/*/{_EVERYBODY}", timeout=1.0)
        names = {str(reply.ok.key_expr).split("/")[3] for reply in replies if reply.ok is not None}
        return frozenset(number for name, number in self._inbox.numbers.items() if name in names)

    def close(self) -> None:
        """Leave the network."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _take(self, sample: zenoh.Sample) -> None:
        if self._inbox.put(sample) in _URGENT:
            self.is_urgent = True
            self._urgent.set()


class ZenohListener:
    """Hears all States of a fleet without being one of it, from the computer of one of its peers."""

    def __init__(self, fleet: FleetFile, building: str, lan: bool = False) -> None:
        """Listen to the network; raises as `ZenohTransport`."""
        fleet = open_to_lan(fleet, lan)
        keys = None if fleet.keys is None else checked_keys(fleet.keys, fleet.name(fleet.number))
        protocol = "tls" if keys else "tcp"
        own = f"{protocol}/127.0.0.1:0"
        settings = zenoh_settings("peer", (own,), (fleet.own_endpoint, *fleet.other_endpoints), keys, fleet.names)
        self._session = _opened(settings, own)
        self._inbox = _Inbox(self._session, fleet, building)

    def received(self) -> list[tuple[int, bytes]]:
        """Return the messages since the last call, with the numbers of the senders."""
        return self._inbox.fetch()

    def received_aside(self) -> list[tuple[int, bytes]]:
        """Return the messages beside the peers' own that have come since the last call, with the numbers of the senders."""
        return self._inbox.fetch_aside()

    def close(self) -> None:
        """Leave the network."""
        self._session.close()  # type: ignore[no-untyped-call]


class LocalBus:
    """Messages by key between the programs of one computer, which one of them joins to all others.

    It never leaves the computer, so that it needs no keys: for what a simulated world and its chairs tell each other.
    """

    def __init__(
        self, port: int, name: str, *, joins: bool = False, hears: Sequence[str], wake: threading.Event
    ) -> None:
        """Join the programs at a port of this computer (`joins`), or be one of them, by a name; `hears` are key expressions.

        A message that comes sets `wake`.

        Raises:
            FleetError: the port is taken, or nobody joins the programs there.
            MissingExtra: the extra [fleet] is not installed.
        """
        end = f"tcp/127.0.0.1:{port}"
        settings = zenoh_settings("router" if joins else "client", (end,) if joins else (), () if joins else (end,))
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=MOST_WAITING)
        self._wake = wake
        self._session = _opened(settings, end)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._there: set[str] = set()
        for each in hears:
            self._session.declare_subscriber(f"{_LOCAL}/{each}", self._take)
        self._token = self._session.liveliness().declare_token(f"{_ALIVE}/{name}")
        self._session.liveliness().declare_subscriber(f"{_ALIVE}/*", self._note_life, history=True)

    def is_there(self, name: str) -> bool:
        """Return whether a program of this name runs; one that is killed is gone within milliseconds."""
        return name in self._there

    def put(self, key: str, data: bytes) -> None:
        """Send bytes to all that hear the key; on a busy computer it waits, so that nothing is lost."""
        if key not in self._publishers:
            import zenoh

            self._publishers[key] = self._session.declare_publisher(
                f"{_LOCAL}/{key}", express=True, congestion_control=zenoh.CongestionControl.BLOCK
            )
        self._publishers[key].put(data)

    def received(self) -> list[tuple[str, bytes]]:
        """Return the messages since the last call, with its keys."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """Leave the others."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _note_life(self, sample: zenoh.Sample) -> None:
        import zenoh

        name = str(sample.key_expr).removeprefix(f"{_ALIVE}/")
        (self._there.discard if sample.kind == zenoh.SampleKind.DELETE else self._there.add)(name)

    def _take(self, sample: zenoh.Sample) -> None:
        self._waiting.append((str(sample.key_expr).removeprefix(f"{_LOCAL}/"), sample.payload.to_bytes()))
        self._wake.set()


def open_session(fleet: FleetFile, lan: bool, mode: str) -> zenoh.Session:
    """Return an open session of a fleet's network as a peer, client or router.

    Raises:
        FleetError: the endpoint is taken, or an endpoint or key is wrong.
        MissingExtra: the extra [fleet] is not installed.
    """
    fleet = open_to_lan(fleet, lan)
    keys = None if fleet.keys is None else checked_keys(fleet.keys, fleet.name(fleet.number))
    listen = () if mode == "client" else (fleet.own_endpoint,)
    settings = zenoh_settings(mode, listen, fleet.other_endpoints, keys, fleet.names)
    return _opened(settings, fleet.own_endpoint)


def _opened(settings: Mapping[str, Any], endpoint: str) -> zenoh.Session:
    if find_spec("zenoh") is None:
        raise MissingExtra(f"chairs that talk need the extra [fleet]: {install_command('fleet')}")
    import zenoh

    os.environ.setdefault(*_THREADS)
    config = zenoh.Config()
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    try:
        with contextlib.redirect_stderr(None):
            return zenoh.open(config)
    except zenoh.ZError as error:
        text = str(error)
        if "in use" in text:
            raise FleetError(
                f"{endpoint} is taken by another program: stop it, or give `listen` another port in the fleet's file"
            ) from None
        raise FleetError(f"the fleet's network cannot be joined at {endpoint}: {text.splitlines()[0][:200]}") from None
