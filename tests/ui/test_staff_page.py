"""The staff's page: its data and form need the token, and a browser shows chairs and gives a priority by keyboard."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from waychair.errors import ConfigError, TaskError
from waychair.ui.staff_page import StaffPage, staff_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

VIEW = {
    "chairs": [
        {"chair": 1, "at": "desk", "goal": "ward", "priority": "routine", "minutes_left": None, "told": "Waits for chair 2."},
        {"chair": 2, "at": "lift", "goal": "", "priority": "", "minutes_left": 4.5, "told": "Stands by."},
    ],
    "queues": [{"place": "corridor", "chairs": [2, 1]}],
    "closed": ["north door"],
    "waited": [
        {"minutes_ago": 3, "waits": 1, "first": None, "place": "corridor", "rule": "the way is closed", "real_s": 12.4, "foreseen_s": None},
    ],
}  # fmt: skip


class Desk:
    """Takes down what was given."""

    def __init__(self) -> None:
        self.given: list[tuple[int, str, str, float]] = []

    def give(self, chair: int, name: str, key: str, minutes: float) -> str:
        """Refuse the key `wrong`."""
        if key == "wrong":
            raise TaskError("the staff's key is wrong")
        self.given.append((chair, name, key, minutes))
        return f"Chair {chair} has {name.upper()}."


@pytest.fixture
def desk() -> Desk:
    """The other side of the page."""
    return Desk()


@pytest.fixture
def address(desk: Desk) -> Iterator[str]:
    """Address of a page that shows `VIEW`; its token is `word`."""
    page = StaffPage("word", desk.give)
    page.view = VIEW
    with staff_page(page) as found:
        yield found


def answer(address: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
    """Return status and text of a request."""
    told = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        with urllib.request.urlopen(urllib.request.Request(address + path, body, told)) as found:
            return found.status, found.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


FORM = {"chair": 1, "priority": "top", "key": "secret", "minutes": 5}


def test_view_and_form_need_the_token_and_the_pages_own_origin(address: str, desk: Desk) -> None:
    right, form = "Bearer word", json.dumps(FORM).encode()
    assert answer(address, "")[0] == 200
    assert json.loads(answer(address, "view", Authorization=right)[1]) == VIEW
    assert answer(address, "priority", form, Authorization=right) == (200, "Chair 1 has TOP.")
    for path, body in (("view", None), ("priority", form)):
        for headers, status in (
            ({}, 401),
            ({"Authorization": "Bearer wrong"}, 401),
            ({"Authorization": "Basic word"}, 401),
            ({"Authorization": right, "Origin": "http://evil.example"}, 403),
            ({"Authorization": right, "Sec_Fetch_Site": "cross-site"}, 403),
            ({"Authorization": right, "Host": "evil.example"}, 403),
        ):
            assert answer(address, path, body, **headers)[0] == status, (path, headers)
    assert desk.given == [(1, "top", "secret", 5.0)]


@pytest.mark.parametrize(
    ("body", "status", "told"),
    [
        (b"{", 400, "The form is damaged"),
        (b'{"chair": 1}', 400, "The form is damaged"),
        (b'{"chair": 1e999, "priority": "top", "key": "k", "minutes": 1}', 400, "The form is damaged"),
        (b" " * 2001, 413, "The form is too long."),
        (json.dumps({**FORM, "key": "wrong"}).encode(), 409, "The staff's key is wrong."),
    ],
)
def test_bad_forms_are_refused_with_a_sentence(address: str, desk: Desk, body: bytes, status: int, told: str) -> None:
    found = answer(address, "priority", body, Authorization="Bearer word")
    assert found[0] == status
    assert told in found[1]
    assert desk.given == []
    assert answer(address, "nowhere", Authorization="Bearer word")[0] == 404
    assert answer(address, "nowhere", b"", Authorization="Bearer word")[0] == 404


def test_a_page_without_a_token_or_port_is_refused(address: str, desk: Desk) -> None:
    with pytest.raises(ConfigError, match="needs a token"), staff_page(StaffPage("", desk.give)):
        pass
    port = int(address.rstrip("/").rpartition(":")[2])
    with pytest.raises(ConfigError, match=f"cannot use port {port}"), staff_page(StaffPage("word", desk.give), port):
        pass


def test_staff_see_the_chairs_and_give_a_priority_by_keyboard_and_axe_finds_no_fault(
    browser: Browser, address: str, desk: Desk
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    page = browser.new_page()
    page.goto(address)
    page.keyboard.press("Tab")
    page.keyboard.type("wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector("#news:has-text('The token is missing or wrong')")
    page.fill("#token", "word")
    page.keyboard.press("Enter")
    page.wait_for_selector("#chairs tr:nth-child(2)")
    shown = page.inner_text("main")
    for told in (
        "Waits for chair 2.",
        "4.5 min more",
        "corridor: chair 2, then 1",
        "north door",
        "the way is closed",
        "nobody",
    ):
        assert told in shown
    assert Axe().run(page).response["violations"] == []
    page.focus("#chair")
    page.keyboard.press("ArrowDown")  # chair 2
    page.keyboard.press("Tab")
    page.keyboard.press("ArrowDown")  # top
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.type("secret")
    page.keyboard.press("Enter")
    page.wait_for_selector("#given:has-text('Chair 2 has TOP.')")
    assert desk.given == [(2, "top", "secret", 10.0)]
    assert page.input_value("#key") == ""
    page.close()
