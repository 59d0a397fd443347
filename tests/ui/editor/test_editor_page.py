"""The building mode in a real browser: by keyboard, by one switch, enlarged, and without faults of accessibility."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.maps.building.buildings import two_storeys
from tests.ui.driving import page_at, until
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.hgraph import NodeKind
from waychair.ui.editor.server import editor_server
from waychair.ui.editor.session import Session

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STATE = "document.querySelector('#state').textContent"
SAID = "document.querySelector('#said').textContent"
LONGER_THAN_A_BOUNCE_MS = 260
PARTS = ("build", "faults", "selected", "parts", "file")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    save_building(Building(tmp_path / "clinic", two_storeys()))
    with Session(tmp_path / "clinic") as found:
        yield found


@contextmanager
def editor_page(browser: Browser, session: Session, **context: Any) -> Iterator[Page]:
    """The page of a session, once it shows the building."""
    with editor_server(session) as address, page_at(browser, address, **context) as page:
        until(lambda: page.evaluate(STATE) != "Loading", "the page does not begin")
        yield page


def test_a_node_is_added_checked_joined_undone_and_saved_by_keyboard(browser: Browser, session: Session) -> None:
    with editor_page(browser, session) as page:
        page.focus("#canvas")
        page.keyboard.press("ArrowUp")
        page.keyboard.press("n")
        until(lambda: "1 errors" in page.evaluate(STATE), "the fault of a loose node is not shown")
        assert page.locator("#faults-list .error").count() == 1
        page.keyboard.press("Control+s")
        until(lambda: "Kept as a draft" in page.evaluate(SAID), "the save is not refused")
        page.keyboard.press("Control+z")
        until(lambda: " 0 errors" in page.evaluate(STATE), "the fault does not go with its cause")
        page.reload()
        until(lambda: not page.is_disabled("#redo"), "redo is gone after a reload")
        page.click("#redo")
        until(lambda: "1 errors" in page.evaluate(STATE), "the edit does not come back")
        page.click("#tab-faults")
        page.click("#faults-list button.error")
        page.click("[data-button='Join these']")
        until(lambda: " 0 errors" in page.evaluate(STATE), "the remedy does not help")
        page.keyboard.press("Control+s")
        until(lambda: page.evaluate(STATE).startswith("Saved"), "the building is not saved")
    assert load_building(session.folder).hgraph == session.draft.hgraph


def test_a_second_page_is_told_and_shows_what_the_first_one_did(browser: Browser, session: Session) -> None:
    with editor_page(browser, session) as one, editor_page(browser, session) as other:
        one.focus("#canvas")
        one.keyboard.press("n")
        until(lambda: "1 errors" in one.evaluate(STATE), "the first page's edit is not done")
        other.focus("#canvas")
        other.keyboard.press("n")
        until(lambda: "errors" in other.evaluate(STATE) and " 0 errors" not in other.evaluate(STATE), "nothing is told")
        assert len(session.history.steps) in (1, 2)


@pytest.mark.nightly
def test_one_switch_adds_a_node_and_writes_its_name(browser: Browser, session: Session) -> None:
    with editor_page(browser, session) as page:
        page.evaluate("localStorage.setItem('building-switch', JSON.stringify({running: true, interval: 0.7}))")
        page.reload()
        until(lambda: page.locator(".scanned").count() > 0, "the frame does not walk")

        def take(selector: str) -> None:
            for _ in ("its group", "itself"):
                until(lambda: page.locator(f"{selector}.scanned").count() == 1, f"the frame misses {selector}")
                is_alone = page.locator(".scanned").count() == 1
                page.keyboard.press("Space", delay=30)
                page.wait_for_timeout(LONGER_THAN_A_BOUNCE_MS)
                if is_alone:
                    return

        take("[data-form='node'] [data-field='name']")
        take("#pad [data-scan]:text-is('a')")
        take("#pad [data-scan]:text-is('Done')")
        take("[data-form='node'] [data-button]")
        until(lambda: len(session.history.steps) == 1, "no node was added")
        assert "a" in {node.name for _, node in session.draft.hgraph.nodes() if node.kind is NodeKind.END}


@pytest.mark.parametrize("look", ["light", pytest.param("dark", marks=pytest.mark.nightly), "at 200 %"])
def test_axe_finds_no_fault_and_nothing_is_cut(browser: Browser, session: Session, look: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    size = {"width": 640, "height": 450} if look == "at 200 %" else {"width": 1280, "height": 900}
    with editor_page(browser, session, viewport=size, color_scheme="dark" if look == "dark" else "light") as page:
        page.focus("#canvas")
        page.keyboard.press(".")
        for part in PARTS:
            page.click(f"#tab-{part}")
            found = Axe().run(page)
            assert found.violations_count == 0, found.generate_report()
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"{part} is cut"
