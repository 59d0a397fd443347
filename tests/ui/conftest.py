"""A chair in the simulator, in real time, and Debian's Chromium; without the browser its tests are skipped."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.ui.noted import Noted
from waychair.trials.live.live_chair import LiveChair
from waychair.ui.server import page_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser

WORLD = "small_clinic"
COUNTDOWN_S = 1.0


@pytest.fixture(scope="module")
def chair() -> Iterator[LiveChair]:
    """A chair without people around."""
    with LiveChair(WORLD, people=False, countdown_s=COUNTDOWN_S) as live:
        yield live


@pytest.fixture
def port(chair: LiveChair) -> Iterator[Noted]:
    """The chair's port; after the test the chair is stopped."""
    yield Noted(chair)
    chair.stop()
    chair.watched(())


@pytest.fixture
def address(port: Noted) -> Iterator[str]:
    """The address of the chair's page."""
    with page_server(port) as served:
        yield served


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium without a window; tests skip without it."""
    program = os.environ.get("WAYCHAIR_CHROMIUM") or shutil.which("chromium")
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium, or name it in WAYCHAIR_CHROMIUM")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program)
        yield chromium
        chromium.close()
