"""Makes the picture of the tab *Touch* while a simulated driver is led: python -m tests.ui.touch_picture docs/touch.png"""

from __future__ import annotations

import shutil
import sys

from playwright.sync_api import sync_playwright

from tests.ui.conftest import WORLD
from tests.ui.driving import pose_of, ready_page, until
from tests.ui.picture import distance
from waychair.control.haptics.profile import HapticsProfile
from waychair.trials.guiding.live_haptics import HapticOptions
from waychair.trials.live.live_chair import LiveChair
from waychair.ui.server import page_server

PLACE = "ward"
ON_THE_WAY_M = 1.5


def main() -> None:
    haptics = HapticOptions(HapticsProfile(speech=False), driver="default")
    with (
        LiveChair(WORLD, people=False, haptics=haptics) as chair,
        page_server(chair) as address,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=shutil.which("chromium")) as browser,
        ready_page(browser, address, viewport={"width": 1280, "height": 1000}) as page,
    ):
        page.click("#help-guide")
        until(lambda: page.get_attribute("#help-guide", "aria-pressed") == "true", "the level does not begin")
        page.click("#tab-haptics")
        page.click(f"#haptics-places button:has-text('{PLACE}')")
        begun = pose_of(chair)
        until(lambda: distance(pose_of(chair), begun) > ON_THE_WAY_M, "the driver gets nowhere")
        page.wait_for_selector("#haptics-glove .motor.on", state="attached")
        page.screenshot(path=sys.argv[1])


if __name__ == "__main__":
    main()
