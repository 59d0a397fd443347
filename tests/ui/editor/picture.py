"""Makes the picture of the building mode: python -m tests.ui.editor.picture docs/building.png"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from tests.ui.driving import page_at, until
from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plan.world import load_levels
from waychair.trials.travel.world_building import building_of_world
from waychair.ui.editor.server import editor_server
from waychair.ui.editor.session import Session

SAID = "document.querySelector('#said').textContent"
LOOSE = {"do": "add_node", "submap": "ground/r1", "kind": "end", "name": "Window", "x": 5.4, "y": 6.2}


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "clinic"
        building_of_world(load_levels("two_floors"), folder, CHAIR_A)
        with (
            Session(folder) as session,
            editor_server(session) as address,
            sync_playwright() as playwright,
            playwright.chromium.launch(executable_path=shutil.which("chromium")) as browser,
        ):
            session.do(session.revision, LOOSE)
            with page_at(browser, address, viewport={"width": 1280, "height": 900}) as page:
                until(lambda: page.locator("#faults-list .error").count() == 2, "the faults are not shown")
                page.click("#tab-faults")
                page.focus("#canvas")
                page.keyboard.press(".")
                page.wait_for_timeout(300)
                page.screenshot(path=sys.argv[1])


if __name__ == "__main__":
    main()
