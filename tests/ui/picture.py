"""Makes the picture of the page in the middle of a drive: python -m tests.ui.picture docs/page.png"""

from __future__ import annotations

import math
import shutil
import sys

from playwright.sync_api import sync_playwright

from tests.ui.conftest import WORLD
from tests.ui.driving import pose_of, ready_page, until
from waychair.trials.live.live_chair import LiveChair
from waychair.types import Pose2
from waychair.ui.server import page_server

PLACE = "ward"
ON_THE_WAY_M = 3.0


def distance(a: Pose2, b: Pose2) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def main() -> None:
    with (
        LiveChair(WORLD, people=False) as chair,
        page_server(chair) as address,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=shutil.which("chromium")) as browser,
        ready_page(browser, address, viewport={"width": 1280, "height": 820}) as page,
    ):
        page.click(f".place:text-is('{PLACE}')")
        page.click("#ask-yes")
        begun = pose_of(chair)
        until(lambda: distance(pose_of(chair), begun) > ON_THE_WAY_M, "the chair gets nowhere")
        page.screenshot(path=sys.argv[1])


if __name__ == "__main__":
    main()
