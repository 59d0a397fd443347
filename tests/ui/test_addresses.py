"""The names and numbers by which phones open the page, and names that stay refused."""

from __future__ import annotations

import ipaddress
import socket

import pytest

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.page_process import page_addresses, page_names, page_sentence
from waychair.ui.guard import is_host
from waychair.ui.own_addresses import own_addresses, own_names


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("chair", ("chair", "chair.local")),
        ("Chair.Example.ORG.", ("chair.example.org", "chair", "chair.local")),
        ("chair.local", ("chair.local", "chair")),
        ("localhost", ()),
        ("localhost.localdomain", ()),
    ],
)
def test_a_computer_answers_to_its_name_and_to_that_with_local(name: str, names: tuple[str, ...]) -> None:
    assert own_names(name) == names


@pytest.mark.parametrize(
    "host",
    [
        "chair",
        "CHAIR:8000",
        "chair.local",
        "chair.local.:8000",
        "192.168.1.7:8000",
        "[fd00::7]:8000",
        "chair.lan",
        "localhost",
    ],
)
def test_own_names_numbers_and_given_names_open_the_page(host: str) -> None:
    assert is_host(host, (*own_names("chair"), "chair.lan."))
    assert is_host(host, ("chair", "chair.lan"))


@pytest.mark.parametrize(
    "host",
    [
        "chair.evil.example", "evil-chair.local", "a.chair.local", "chair.local.evil.example", "local", ".local", "",
        ".", "chair.localhost", "192.168.1.7.evil.example", "chair local", "[chair.local]", "chair.fritz.box",
    ],
)  # fmt: skip
def test_foreign_names_that_may_point_here_stay_refused(host: str) -> None:
    assert not is_host(host, (*own_names("chair"), "chair.lan"))


def test_the_addresses_are_this_computer_s_own_and_no_loopback() -> None:
    for address in own_addresses():
        assert ipaddress.IPv4Address(address) not in ipaddress.ip_network("127.0.0.0/8")
        socket.create_server((address, 0)).close()


def test_the_addresses_for_phones_begin_with_numbers_and_end_with_the_name() -> None:
    token = "a-token-nobody-guesses"
    addresses = page_addresses(8000, True, token, ("chair.lan",))
    numbers = tuple(f"http://{each}:8000/#token={token}" for each in own_addresses())
    name = f"http://{own_names()[-1]}:8000/#token={token}" if own_names() else None
    assert addresses == tuple(each for each in (*numbers, f"http://chair.lan:8000/#token={token}", name) if each)
    said = page_sentence(8000, True, token, ("chair.lan",))
    assert all(each in said.split() for each in addresses)
    assert page_sentence(8000, False, "") == "the page is at http://127.0.0.1:8000/"


@pytest.mark.parametrize(
    "name", ["http://chair.lan", "chair.lan:8000", "chair lan", "", "-chair", "chair..lan", "a" * 254]
)
def test_a_page_name_that_is_no_host_name_is_refused(name: str) -> None:
    with pytest.raises(BadArgument, match="is no host name"):
        page_names((name,), lan=True)


def test_a_page_name_needs_the_network() -> None:
    assert page_names(("chair.lan",), lan=True) == (*own_names(), "chair.lan")
    with pytest.raises(BadArgument, match="needs --page-lan"):
        page_names(("chair.lan",), lan=False)
