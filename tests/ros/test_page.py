"""The page of the whole stack, as `waychair up` serves it: real processes, real DDS, the web server, in real time."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import pytest

from tests.ports import free_port
from tests.ros.realtime import ALONE

for needed in ("rclpy", "fastapi", "websockets"):
    if importlib.util.find_spec(needed) is None:
        pytest.skip(f"{needed} is not installed", allow_module_level=True)

from evaluation.runs.live_stack import LiveStack, held_at, jitter_ms, until_released
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import load_zones
from waychair.runtime.rider.sentences import sentence

if TYPE_CHECKING:
    from tests.ros.harness import Harness

pytestmark = ALONE

SOON_MS = 100.0
TRIES = 5
"""A busy computer may end a drive."""

PATIENCE_S = 240.0
"""So long a drive that a busy computer ends is asked for again, and a page is waited for; only a failing test takes it all."""

NEAR = [1.9, 1.0, 0.0]


class Page:
    """An open page: it answers all messages, and keeps the last one in `view`; it sends the position of `stick`, then its
    release."""

    def __init__(self, port: int, name: str) -> None:
        self._port, self._name, self._ended = port, name, threading.Event()
        self.view: dict[str, Any] = {}
        self.stick: tuple[float, float] | None = None
        self._thread = threading.Thread(target=self._live)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def do(self, command: str, **asked: object) -> dict[str, Any]:
        """The answer to a command by POST."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self._port}/api/do/{command}",
            json.dumps(asked).encode(),
            {"content-type": "application/json"},
        )
        try:
            with urllib.request.urlopen(request, timeout=10.0) as answer:
                return dict(json.load(answer))
        except (urllib.error.URLError, ConnectionError) as error:
            return {"done": False, "sentence": str(error)}

    def _live(self) -> None:
        address = f"ws://127.0.0.1:{self._port}/api/live"
        while not self._ended.is_set():
            try:
                with connect(address, origin=f"http://127.0.0.1:{self._port}", max_size=None) as link:
                    link.send(json.dumps({"token": "", "page": self._name}))
                    self._listen(link)
            except (OSError, WebSocketException, TimeoutError):
                time.sleep(0.2)

    def _listen(self, link: Any) -> None:
        held: tuple[float, float] | None = None
        while not self._ended.is_set():
            told = json.loads(link.recv(timeout=2.0))
            if told.get("type") == "view":
                self.view = told
                link.send(json.dumps({"seen": told["n"], "visible": True}))
                if (stick := self.stick) is not None:
                    link.send(json.dumps({"do": "steer", "with": {"forward": stick[0], "turn": stick[1]}, "id": 0}))
                elif held is not None:
                    link.send(json.dumps({"do": "release", "id": 0}))
                held = stick


@pytest.fixture(scope="module")
def port() -> int:
    return free_port()


@pytest.fixture(scope="module")
def stack(ros: Harness, port: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveStack]:
    folder = tmp_path_factory.mktemp("page")
    quick = folder / "quick.yaml"
    quick.write_text("bridge: {ros__parameters: {supervisor.countdown_s: 1.0}}\n", encoding="utf-8")
    options = ("--no-camera", "--no-people", "--page", "--page-port", str(port), "--params", str(quick))
    with LiveStack(folder, ros.domain, *options) as running:
        yield running


@pytest.fixture
def page(stack: LiveStack, port: int) -> Iterator[Page]:
    with Page(port, "tests") as open_page:
        stack.until(lambda: open_page.view.get("localisation") == "ok", "the page")
        yield open_page


def sets_off(stack: LiveStack, page: Page, there: Callable[[], bool], **goal: object) -> None:
    """Ask for a goal by the page, by default the far place, and confirm it; ask again if a busy computer ends the drive."""
    asked_s = -10.0

    def done() -> bool:
        nonlocal asked_s
        if there():
            return True
        if page.view["waits"]:
            page.do("confirm")
        elif not page.view["goal"] and time.monotonic() - asked_s > 3.0:
            if page.view["obstacles"]:
                page.do("reset")
            page.do("go", **(goal or {"place": "ward"}))
            asked_s = time.monotonic()
        return False

    stack.until(done, "the drive", PATIENCE_S)


def until_ready(stack: LiveStack, page: Page) -> None:
    """Reset the faults of a busy computer until nothing prevents a drive."""
    reset_s = -10.0

    def ready() -> bool:
        nonlocal reset_s
        if page.view["obstacles"] and time.monotonic() - reset_s > 3.0:
            page.do("reset")
            reset_s = time.monotonic()
        return not page.view["obstacles"] and page.view["localisation"] == "ok"

    stack.until(ready, "the chair to be ready")


def steers(page: Page) -> bool:
    """Whether the chair turns as the page's stick asks for."""
    return bool(page.view["mode"] == "assisted" and page.view["steered"] and page.view["twist"][1] > 0.2)


def moves(page: Page) -> bool:
    return abs(page.view["twist"][0]) > 0.1


def test_a_goal_of_a_page_is_counted_down_and_reached(stack: LiveStack, page: Page) -> None:
    stack.until(lambda: "did you mean" in page.do("go", place="wart")["sentence"], "the places of the map")
    assert not page.do("confirm")["done"]
    counted = False

    def arrived() -> bool:
        nonlocal counted
        counted = counted or page.view["countdown"] is not None
        return bool(page.view["last"] == "Arrived at 1.9, 1.0.")

    sets_off(stack, page, arrived, pose=NEAR)
    assert counted
    assert abs(stack.true_pose().x - NEAR[0]) < 0.2


def test_stop_on_a_page_releases_the_lines_within_a_tenth_of_a_second(stack: LiveStack, page: Page) -> None:
    pressed_ns = gone_ns = tries = 0
    while not held_at(stack, pressed_ns):
        assert (tries := tries + 1) <= TRIES
        sets_off(stack, page, lambda: moves(page))
        pressed_ns = time.time_ns()
        assert page.do("stop") == {"done": True, "sentence": "stopped"}
        gone_ns = until_released(stack, pressed_ns)
    assert (gone_ns - pressed_ns) / 1e6 < SOON_MS + jitter_ms(stack, pressed_ns)
    stack.until(lambda: page.view["mode"] == "stopped" and not moves(page), "the chair to rest")
    assert page.view["last"].startswith("Stop was pressed")


def test_a_drive_ends_when_its_last_page_is_closed(stack: LiveStack, port: int) -> None:
    said = ""
    for _ in range(TRIES):
        with Page(port, "first") as first, Page(port, "second") as second:
            stack.until(lambda: first.view and second.view, "two pages")
            sets_off(stack, first, lambda: moves(second) and second.view["goal"] == "ward")
        stack.until(lambda: not stack.driving, "the drive to end", 5.0)
        said = stack.state.last_stop if stack.state is not None else ""
        if said.startswith("no page with a Stop button answers"):
            break
    assert said.startswith("no page with a Stop button answers")


@pytest.mark.nightly
def test_a_drive_ends_when_the_pages_server_dies(stack: LiveStack, page: Page) -> None:
    sets_off(stack, page, lambda: moves(page))
    server = stack.pids["page"]
    os.kill(server, signal.SIGKILL)
    stack.until(lambda: not stack.driving, "the drive to end", 5.0)
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.v) < 0.01, "the chair to rest", 10.0)
    page.view = {}
    stack.until(lambda: page.view.get("last"), "the page to be back", PATIENCE_S)
    assert stack.state is not None
    assert page.view["last"] == sentence(stack.state.last_stop)  # known to the new server too
    assert not stack.driving


def test_a_page_steers_and_a_release_stops_the_chair(stack: LiveStack, page: Page) -> None:
    ends = time.monotonic() + PATIENCE_S
    while not steers(page):
        assert time.monotonic() < ends, page.view
        page.stick = None  # a push that a busy computer has interrupted counts only after a release
        stack.spin(1.0)
        until_ready(stack, page)
        page.stick, push_ends = (0.0, 1.0), time.monotonic() + 8.0
        while not steers(page) and time.monotonic() < push_ends:
            stack.spin(0.05)
    page.stick = None
    stack.until(lambda: abs(page.view["twist"][1]) < 0.02, "the chair to rest", 5.0)
    assert page.do("stop")["done"]
    stack.until(lambda: page.view["mode"] == "stopped", "the page to show it")
    stack.until(lambda: stack.really is not None and abs(stack.really.twist.omega) < 0.01, "the chair to rest", 5.0)


def test_drawings_of_a_page_are_in_the_files_of_the_map_and_known_to_all_nodes(stack: LiveStack, page: Page) -> None:
    folder = stack.folder / "run" / "map"
    first = page.view["layout"]
    assert page.do("place_here", name="desk", tolerance_m=0.05, tolerance_rad=0.03)["done"]
    wall = [[6.0, 5.0], [7.0, 5.0], [7.0, 6.0]]
    assert page.do("set_zone", name="wet", rule="keep_out", polygon=wall)["done"]
    stack.until(lambda: page.view["layout"] > first, "the page to show it")
    stack.until(lambda: "desk" in stack.client.places(), "the navigator to know it")
    assert "desk" in load_places(folder)
    assert [zone.name for zone in load_zones(folder)] == ["wet"]
    map_before = page.view["map"]
    assert page.do("erase", polygon=[[5.0, 4.2], [5.6, 4.2], [5.6, 4.8], [5.0, 4.8]])["done"]
    stack.until(lambda: page.view["map"] > map_before, "the mapper to show it")
    for _ in range(3):
        assert page.do("undo")["done"]
    assert "nothing to undo" in page.do("undo")["sentence"]
    stack.until(lambda: "desk" not in stack.client.places(), "the navigator to forget it")


def test_no_process_runs_on_after_a_killed_stack(stack: LiveStack) -> None:
    pids = stack.pids.values()
    assert pids
    assert all(map(is_alive, pids))
    stack.end(signal.SIGKILL)
    stack.until(lambda: not any(map(is_alive, pids)), "the processes to end")


def is_alive(pid: int) -> bool:
    """Whether there is such a process, which is not merely waited for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1][0] != "Z"
    except OSError:
        return False
