"""Chairs over Zenoh: they meet by themselves on one computer, and strangers are kept out."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import pytest

from waychair.errors import FleetError
from waychair.runtime.fleet.fleet_file import FleetFile, load_fleet, open_to_lan
from waychair.runtime.fleet.network.fleet_keys import checked_keys, new_keys
from waychair.runtime.fleet.network.zenoh_transport import LocalBus, ZenohTransport

CHAIRS = (1, 2, 3)


def _ports(count: int) -> list[int]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def _fleet(number: int, ports: list[int], keys: Path | None = None, protocol: str = "tcp") -> FleetFile:
    ends = [f"{protocol}/127.0.0.1:{port}" for port in ports]
    others = tuple(end for k, end in enumerate(ends, 1) if k != number)
    return FleetFile("T", number, CHAIRS, (), others, ends[number - 1], keys)


def _until(holds: Callable[[], bool]) -> bool:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        if holds():
            return True
        time.sleep(0.02)
    return False


def _heard(one: ZenohTransport, other: ZenohTransport, data: bytes) -> bool:
    """Return whether the other one hears a message of the first one, which is repeated, within half a second."""
    return any(each == data for _, each in _all_heard(one, other, data, None, 0.5))


def _all_heard(
    one: ZenohTransport, other: ZenohTransport, data: bytes, to: int | None, seconds: float = 10
) -> list[tuple[int, bytes]]:
    """Return all that the other one hears, with the senders, until it hears a message, which is repeated: a busy link drops what is sent once."""
    found: list[tuple[int, bytes]] = []
    end = time.monotonic() + seconds
    while all(each != data for _, each in found) and time.monotonic() < end:
        one.send(to, "state", data)
        time.sleep(0.02)
        found += other.received()
    return found


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as found:
        yield found


def test_three_peers_meet_on_one_computer_though_two_know_only_the_first(stack: ExitStack) -> None:
    ports = _ports(3)
    ends = [f"tcp/127.0.0.1:{port}" for port in ports]
    fleets = [FleetFile("T", n, CHAIRS, (), (ends[0],) if n > 1 else (ends[1],), ends[n - 1]) for n in CHAIRS]
    first, second, third = (stack.enter_context(closing(ZenohTransport(each, "b"))) for each in fleets)
    assert _until(lambda: _heard(second, third, b"hello"))
    assert (2, b"for 3") in _all_heard(second, third, b"for 3", 3)
    assert (2, b"for 3") not in first.received()
    assert _until(lambda: first.alive() == frozenset(CHAIRS))


def test_a_peer_that_was_there_first_goes_on_looking_for_the_others_that_it_knows(stack: ExitStack) -> None:
    ports = _ports(3)
    ends = [f"tcp/127.0.0.1:{port}" for port in ports]
    first = stack.enter_context(closing(ZenohTransport(FleetFile("T", 1, CHAIRS, (), (ends[1],), ends[0]), "b")))
    second = stack.enter_context(closing(ZenohTransport(FleetFile("T", 2, CHAIRS, (), (ends[2],), ends[1]), "b")))
    assert _until(lambda: _heard(second, first, b"found"))


def test_a_port_that_is_taken_is_named(stack: ExitStack) -> None:
    ports = _ports(3)
    stack.enter_context(closing(ZenohTransport(_fleet(1, ports), "b")))
    with pytest.raises(FleetError, match=f"127.0.0.1:{ports[0]} is taken by another program"):
        ZenohTransport(_fleet(1, ports), "b")


def test_a_peer_that_has_left_hears_nothing() -> None:
    ports = _ports(3)
    peer = ZenohTransport(_fleet(1, ports), "b")
    peer.close()
    assert (peer.received(), peer.received_aside()) == ([], [])


def test_a_message_that_is_too_large_is_not_taken_in(stack: ExitStack) -> None:
    ports = _ports(3)
    one, two = (stack.enter_context(closing(ZenohTransport(_fleet(n, ports), "b"))) for n in (1, 2))
    assert _heard(one, two, b"small")
    for to in (None, 2):
        for _ in range(5):
            one.send(to, "state", b"x" * 1_000_000)
            time.sleep(0.05)
        found = _all_heard(one, two, b"end", to)
        assert (1, b"end") in found
        assert set(found) <= {(1, b"small"), (1, b"end")}


def test_certificates_of_the_site_are_heard_in_their_own_name_only(stack: ExitStack, tmp_path: Path) -> None:
    for folder, names in ((tmp_path / "own", ("chair1", "chair2")), (tmp_path / "foreign", ("chair3",))):
        for name in names:
            new_keys(folder, name)
    ports = _ports(3)
    one, two = (
        stack.enter_context(closing(ZenohTransport(_fleet(n, ports, tmp_path / "own", "tls"), "b", lan=True)))
        for n in (1, 2)
    )
    assert _until(lambda: _heard(two, one, b"own"))
    two._session.put("waychair/b/state/chair1/all", b"forged")
    forged = two._session.liveliness().declare_token("waychair/b/alive/chair3/all")
    assert _heard(two, one, b"again")
    assert not any(data == b"forged" for _, data in one.received())
    assert one.alive() == {1, 2}
    forged.undeclare()
    third = stack.enter_context(closing(ZenohTransport(_fleet(3, ports, tmp_path / "foreign", "tls"), "b", lan=True)))
    assert not _heard(third, one, b"foreign authority")
    plain = replace(_fleet(3, _ports(3)), endpoints=(f"tcp/127.0.0.1:{ports[0]}",))
    fourth = stack.enter_context(closing(ZenohTransport(plain, "b")))
    assert not _heard(fourth, one, b"no certificate")


def test_nothing_leaves_this_computer_without_lan_and_keys() -> None:
    fleet = FleetFile("T", 1, CHAIRS)
    assert all("127.0.0.1" in end for end in (fleet.own_endpoint, *fleet.other_endpoints))
    assert open_to_lan(fleet, lan=False) == fleet
    far = replace(fleet, listen="tls/0.0.0.0:7450")
    with pytest.raises(FleetError, match="beyond this computer: give --lan"):
        open_to_lan(far, lan=False)
    with pytest.raises(FleetError, match="--lan needs keys"):
        open_to_lan(far, lan=True)
    with pytest.raises(FleetError, match="is not encrypted"):
        open_to_lan(replace(far, listen="tcp/0.0.0.0:7450", keys=Path("keys")), lan=True)


def test_keys_that_are_missing_foreign_expired_or_of_another_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FleetError, match=r"there is no .*authority.pem: make keys"):
        checked_keys(tmp_path, "chair1")
    files = new_keys(tmp_path, "chair1")
    assert files.key.stat().st_mode & 0o77 == 0
    assert checked_keys(tmp_path, "chair1") == files
    with pytest.raises(FleetError, match="has keys of chair1 already"):
        new_keys(tmp_path, "chair1")
    new_keys(tmp_path, "chair2", days=-1)
    with pytest.raises(FleetError, match="the certificate of chair2 is valid until"):
        checked_keys(tmp_path, "chair2")
    other = new_keys(tmp_path / "other", "chair3")
    for path in (other.certificate, other.key):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    with pytest.raises(FleetError, match="the certificate of chair3 is of another authority"):
        checked_keys(tmp_path, "chair3")
    (tmp_path / "chair4.pem").write_bytes(files.certificate.read_bytes())
    (tmp_path / "chair4.key").write_bytes(files.key.read_bytes())
    with pytest.raises(FleetError, match="is the certificate of chair1, not of chair4"):
        checked_keys(tmp_path, "chair4")
    files.key.write_bytes(other.key.read_bytes())
    with pytest.raises(FleetError, match="does not belong to"):
        checked_keys(tmp_path, "chair1")
    files.certificate.write_text("nothing")
    with pytest.raises(FleetError, match="are damaged"):
        checked_keys(tmp_path, "chair1")
    with pytest.raises(FleetError, match="no name for keys"):
        new_keys(tmp_path, "../chair5")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("building: T\nnumber: 1\nchairs: [1, 1]", "the number 1 comes twice"),
        ("building: T\nnumber: 4\nchairs: [1, 2]", "number 4 is neither a chair nor a voter"),
        ("building: T\nnumber: 1\nchairs: []", "no chair is named"),
        ("building: T\nnumber: 1\nchairs: [1, 5000]", "has the number 5000"),
        ("building: T\nnumber: 1\nchairs: [1]\nchair: 3", "is no fleet file"),
        ("building: T\nnumber: 1\nchairs: [1]\nlisten: somewhere", "'somewhere' is no endpoint"),
        ("][", "is no fleet file"),
    ],
)
def test_an_impossible_fleet_file_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text(text)
    with pytest.raises(FleetError, match=said):
        load_fleet(path)


def test_a_fleet_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text("building: T\nnumber: 2\nchairs: [1, 2]\nvoters: [9]\nkeys: keys\n")
    fleet = load_fleet(path)
    assert fleet.names == ("chair1", "chair2", "voter9")
    assert fleet.keys == tmp_path / "keys"
    assert fleet.traffic_graph().name == "T"


def test_programs_of_one_computer_hear_each_other_and_see_who_is_gone(stack: ExitStack) -> None:
    port, wake = _ports(1)[0], threading.Event()
    with pytest.raises(FleetError, match="cannot be joined"):
        LocalBus(port, "early", hears=(), wake=wake)
    stack.enter_context(closing(LocalBus(port, "joins", joins=True, hears=("a/*",), wake=wake)))
    with pytest.raises(FleetError, match=f"127.0.0.1:{port} is taken"):
        LocalBus(port, "second", joins=True, hears=(), wake=wake)
    one = stack.enter_context(closing(LocalBus(port, "one", hears=("b/1",), wake=wake)))
    two = LocalBus(port, "two", hears=("a/*",), wake=wake)
    assert _until(lambda: one.is_there("two") and two.is_there("one"))

    def is_heard() -> bool:
        two.put("b/1", b"for one")
        return ("b/1", b"for one") in one.received()

    assert _until(is_heard)
    two.put("b/2", b"for nobody")
    two.close()
    assert _until(lambda: not one.is_there("two"))
    assert wake.is_set()
