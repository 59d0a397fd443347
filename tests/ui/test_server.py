"""The page's server with a chair in the simulator: access, commands, and messages to pages."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from tests.ui.noted import Noted
from waychair.errors import ConfigError, OutputError
from waychair.maps.drawn.zones import Rule, Zone
from waychair.runtime.pages.chair_port import PortAnswer
from waychair.trials.live.live_chair import LiveChair
from waychair.types import OccupancyGrid, Pose2
from waychair.ui.commands import COMMANDS, STICK, obey
from waychair.ui.guard import is_host, is_token
from waychair.ui.page_messages import MOST_POINTS, THEMES, grid_picture
from waychair.ui.server import UNAUTHORISED, app, page_server

HERE = "http://127.0.0.1:8000"
TOKEN = "a token nobody guesses"
PATHS = ("/", "/static/page.css", "/leaflet/leaflet.js", "/api/grid.png", "/api/nothing", "/nothing")


@pytest.fixture
def client(port: Noted) -> Iterator[TestClient]:
    with TestClient(app(port), base_url=HERE) as running:
        yield running


@pytest.fixture
def guarded(port: Noted) -> Iterator[TestClient]:
    with TestClient(
        app(port, TOKEN, names=("chair.example",), local=False), base_url="http://192.0.2.7:8000"
    ) as running:
        yield running


def told(live: WebSocketTestSession, kind: str, when: Callable[[Any], bool] = lambda _: True) -> Any:
    """Return the next message of a kind that satisfies a condition; answer views as a page does."""
    for _ in range(200):
        message = json.loads(live.receive_text())
        if message["type"] == "view":
            live.send_json({"seen": message["n"], "visible": True})
        if message["type"] == kind and when(message):
            return message
    raise AssertionError(f"no such {kind} in 200 messages")


def until(condition: Callable[[], bool], seconds: float = 20.0) -> bool:
    """Return whether a condition holds within a time that only a broken program needs."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def socket_of(client: TestClient) -> str:
    """The address of the pages' socket."""
    return str(client.base_url.copy_with(scheme="ws", path="/api/live"))


def opened(client: TestClient, page: str = "one", token: str = "") -> Any:
    """A page's socket that has sent its hello, once entered."""

    class Opened:
        def __enter__(self) -> WebSocketTestSession:
            self.live = client.websocket_connect(socket_of(client)).__enter__()
            self.live.send_json({"token": token, "page": page})
            return self.live

        def __exit__(self, *_: object) -> None:
            self.live.__exit__(None, None, None)

    return Opened()


@pytest.mark.parametrize("path", PATHS)
def test_every_answer_carries_the_safety_headers(client: TestClient, path: str) -> None:
    headers = client.get(path).headers
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "no-cache" in headers["cache-control"]


def test_the_page_requests_nothing_from_other_servers(client: TestClient) -> None:
    page = client.get("/").text
    assert "http" not in page.replace("http-equiv", "")
    assert "<script>" not in page
    assert "style=" not in page


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "192.0.2.7", "", "["])
def test_foreign_host_names_for_this_computer_are_refused(client: TestClient, path: str, host: str) -> None:
    answer = client.get(path, headers={"host": host})
    assert answer.status_code == 403


@pytest.mark.parametrize("host", ["localhost", "localhost:9000", "127.0.0.1:8000", "127.0.0.2", "[::1]:8000"])
def test_this_computer_is_accepted_under_any_of_its_own_names(client: TestClient, host: str) -> None:
    assert client.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://127.0.0.1:9000", "http://localhost:8000", "http://[::1"]
)
def test_pages_of_other_sites_can_neither_send_nor_receive(client: TestClient, port: Noted, origin: str) -> None:
    assert client.post("/api/do/go", json={"place": "lift"}, headers={"origin": origin}).status_code == 403
    assert client.get("/api/grid.png", headers={"origin": origin}).status_code == 403
    with (
        pytest.raises(WebSocketDisconnect) as refusal,
        client.websocket_connect(socket_of(client), headers={"origin": origin}),
    ):
        pass
    assert refusal.value.code == 4403
    assert port.calls == []


def test_requests_marked_by_the_browser_as_caused_by_another_site_are_refused(client: TestClient) -> None:
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 404), ("none", 404)):
        assert client.get("/api/nothing", headers={"sec-fetch-site": site}).status_code == status


def test_its_own_page_is_accepted(client: TestClient) -> None:
    with client.websocket_connect(socket_of(client), headers={"origin": HERE}) as live:
        live.send_json({"token": "", "page": "one"})
        assert told(live, "view")["type"] == "view"


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - set(STICK)))
@pytest.mark.parametrize("header", ["", "Bearer", "Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x"])
def test_no_command_is_obeyed_without_the_token(guarded: TestClient, port: Noted, name: str, header: str) -> None:
    answer = guarded.post(f"/api/do/{name}", json={}, headers={"authorization": header})
    assert answer.status_code == 401
    assert port.calls == []


def test_nothing_is_shown_without_the_token(guarded: TestClient) -> None:
    for path in ("/api/grid.png", "/api/picture.jpg"):
        assert guarded.get(path).status_code == 401
    for token in ("", "wrong", TOKEN[:-1]):
        with opened(guarded, token=token) as live:
            with pytest.raises(WebSocketDisconnect) as refusal:
                live.receive_text()
            assert refusal.value.code == UNAUTHORISED


@pytest.mark.parametrize(
    "hello", ["no json", "[]", "7", "{}", '{"page": ""}', '{"page": "one", "token": 7}', '{"page": ' + 60_000 * "["]
)
def test_a_socket_without_a_valid_hello_is_closed(guarded: TestClient, hello: str) -> None:
    with guarded.websocket_connect(socket_of(guarded)) as live:
        live.send_text(hello)
        with pytest.raises(WebSocketDisconnect) as refusal:
            live.receive_text()
        assert refusal.value.code == UNAUTHORISED


def test_the_token_permits_everything(guarded: TestClient, port: Noted) -> None:
    bearer = {"authorization": f"Bearer {TOKEN}"}
    with opened(guarded, token=TOKEN) as live:
        told(live, "view")
        assert guarded.get("/api/grid.png", headers=bearer).status_code == 200
    assert guarded.post("/api/do/stop", headers=bearer).json()["done"]
    assert [call.name for call in port.calls] == ["stop"]


def test_a_token_is_compared_completely_and_without_a_token_none_is_requested() -> None:
    assert is_token(TOKEN, TOKEN)
    assert is_token("", "")
    assert is_token("anything", "")
    assert not any(is_token(told, TOKEN) for told in ("", TOKEN[:-1], TOKEN + " ", "ä"))


@pytest.mark.parametrize(("host", "known"), [("chair.example:80", True), ("CHAIR.example", True), ("10.0.0.3", True),
                                             ("fe80::1", False), ("[fe80::1]", True), ("other.example", False)])  # fmt: skip
def test_from_other_computers_addresses_and_given_names_are_accepted(host: str, known: bool) -> None:
    assert is_host(host, ("chair.example",)) is known


def test_a_page_open_to_the_network_needs_a_token(chair: LiveChair) -> None:
    with pytest.raises(ConfigError, match="token"), page_server(chair, host="0.0.0.0"):
        pass


def test_a_taken_port_is_reported(chair: LiveChair) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        with pytest.raises(OutputError, match=str(number)), page_server(chair, http_port=number):
            pass


def test_a_page_gets_outline_map_layout_and_views(client: TestClient, chair: LiveChair) -> None:
    with opened(client) as live:
        assert len(told(live, "chair")["outline"]) >= 4
        view = told(live, "view", lambda view: view["pose"] is not None and view["scan"])
        assert view["mode"] in ("manual", "stopped")
        assert len(view["scan"]) <= 2 * MOST_POINTS
        assert view["next"]
    with opened(client) as live:
        grid = chair.grid()
        assert grid is not None
        assert told(live, "map")["cells"] == [grid.cells.shape[1], grid.cells.shape[0]]
        names = {place["name"] for place in told(live, "layout")["places"]}
        assert names == set(chair.layout().places)


def test_the_map_is_sent_once_and_again_after_a_change(client: TestClient) -> None:
    with opened(client) as live:
        revision = told(live, "map")["revision"]
        first = client.get("/api/grid.png")
        assert first.headers["content-type"] == "image/png"
        tag = {"if-none-match": first.headers["etag"]}
        assert client.get("/api/grid.png", headers=tag).status_code == 304
        assert client.get("/api/grid.png?theme=dark", headers=tag).status_code == 200
        assert client.get("/api/grid.png?theme=pink").status_code == 404
        ghost = {"polygon": [[3.0, 3.0], [3.5, 3.0], [3.5, 3.5]]}
        assert client.post("/api/do/erase", json=ghost).json()["done"]
        told(live, "map", lambda message: message["revision"] != revision)
        assert client.get("/api/grid.png", headers=tag).status_code == 200
        assert client.post("/api/do/undo").json()["done"]


@pytest.mark.parametrize("theme", THEMES)
def test_walls_have_contrast_in_the_picture_of_the_map_and_north_is_up(theme: str) -> None:
    cells = np.array([[0, 100, -1], [0, 0, 100]], np.int8)
    picture = cv2.imdecode(np.frombuffer(grid_picture(OccupancyGrid(cells, 0.05), theme), np.uint8), cv2.IMREAD_COLOR)
    linear = np.where((share := picture[..., ::-1] / 255) <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    light = linear @ (0.2126, 0.7152, 0.0722)
    free, unknown, wall = light[1, 0], light[1, 2], light[0, 2]
    assert light[1, 1] == wall
    assert light[0, 0] == free
    for ground in (free, unknown):  # WCAG 2.2: 1.4.11
        assert (max(wall, ground) + 0.05) / (min(wall, ground) + 0.05) >= 3.0


def test_commands_by_socket_are_answered_by_number(client: TestClient, port: Noted) -> None:
    with opened(client) as live:
        live.send_json({"do": "go", "with": {"place": "nowhere"}, "id": 4})
        live.send_json({"do": "stop", "id": 5})
        live.send_json({"do": "dance", "id": 6})
        answers = {answer["id"]: answer for answer in (told(live, "answer") for _ in range(3))}
    assert not answers[4]["done"]
    assert "nowhere" in answers[4]["sentence"]
    assert answers[5]["done"]
    assert "reload" in answers[6]["sentence"]


@pytest.mark.parametrize("said", ["no json", "[1, 2]", '"seen"', "9" * 400, '{"a": ' + 60_000 * "["])
def test_a_page_with_an_invalid_message_is_dropped(client: TestClient, said: str) -> None:
    with opened(client) as live:
        told(live, "view")
        live.send_text(said)
    with opened(client) as live:
        told(live, "view")


def test_stop_waits_for_nothing(client: TestClient, port: Noted) -> None:
    port.gates["go"] = port.gates["undo"] = threading.Event()
    with opened(client) as live:
        for number in range(20):
            live.send_json({"do": "go" if number % 2 else "undo", "id": number})
        live.send_json({"do": "stop", "id": 99})
        assert told(live, "answer", lambda answer: answer["id"] == 99)["done"]
        assert client.post("/api/do/stop").json()["done"]
        assert not port.named("go")
        port.gates["go"].set()


def test_only_the_newest_joystick_position_counts(client: TestClient, port: Noted) -> None:
    port.gates["steer"] = threading.Event()
    with opened(client) as live:
        for number in range(10):
            live.send_json({"do": "steer", "with": {"forward": 0.1 * number, "turn": 0.0}, "id": number})
        live.send_json({"do": "release", "id": 10})
        live.send_json({"do": "stop", "id": 11})
        told(live, "answer", lambda answer: answer["id"] == 11)
        port.gates["steer"].set()
        live.send_json({"do": "release", "id": 12})
        told(live, "answer", lambda answer: answer["id"] == 12)
    assert [call.asked[0] for call in port.named("steer")] == [0.0]


def test_a_closed_page_releases_the_stick(client: TestClient, port: Noted) -> None:
    with opened(client) as live:
        live.send_json({"do": "steer", "with": {"forward": 0.0, "turn": 0.0}, "id": 1})
        told(live, "answer")
    assert until(lambda: bool(port.named("release")))


def test_steering_by_post_is_refused(client: TestClient) -> None:
    for name in (*STICK, "dance"):
        assert client.post(f"/api/do/{name}", json={}).status_code == 404
    assert client.get("/api/do/stop").status_code == 405


def test_invalid_or_too_long_json_is_refused(client: TestClient, port: Noted) -> None:
    assert client.post("/api/do/stop", content=b"{").status_code == 400
    assert client.post("/api/do/stop", content=b"[]").status_code == 400
    assert client.post("/api/do/stop", content=b'{"a": ' + 60_000 * b"[").status_code == 400
    assert client.post("/api/do/stop", content=b'{"a": "' + b"a" * 70_000).status_code == 413
    assert port.calls == []


def test_pages_count_while_they_are_visible_and_answer(client: TestClient, port: Noted) -> None:
    with opened(client, "one") as live:
        assert until(lambda: bool(port.watchers) and port.watchers[-1] == ("one",))
        live.send_json({"seen": 1, "visible": False})
        assert until(lambda: port.watchers[-1] == ())
        told(live, "view")
        assert until(lambda: port.watchers[-1] == ("one",))
    assert until(lambda: port.watchers[-1] == ())


def test_a_server_that_ends_leaves_neither_threads_nor_pages(port: Noted) -> None:
    before = set(threading.enumerate())
    with page_server(port) as address:
        assert httpx.get(address).status_code == 200
        assert until(lambda: len(port.watchers) > 2)
    assert until(lambda: set(threading.enumerate()) <= before)  # a thread takes a moment to end
    count = len(port.watchers)
    assert port.watchers[-1] == ()
    time.sleep(0.5)
    assert len(port.watchers) == count
    with pytest.raises(httpx.ConnectError):
        httpx.get(address)


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("go", {}),
        ("go", {"place": "lift", "pose": [0, 0, 0]}),
        ("go", {"pose": [0, 0]}),
        ("go", {"pose": [1e9, 0, 0]}),
        ("go", {"place": 7}),
        ("stop", {"really": True}),
        ("place_here", {"name": "", "tolerance_m": 0.1, "tolerance_rad": 0.1}),
        ("place_here", {"name": "bed", "tolerance_m": 0.0, "tolerance_rad": 0.1}),
        ("place_here", {"name": "b" * 61, "tolerance_m": 0.1, "tolerance_rad": 0.1}),
        ("steer", {"forward": 1.01, "turn": 0.0}),
        ("steer", {"forward": float("nan"), "turn": 0.0}),
        ("steer", {"forward": 0.0}),
        ("set_zone", {"name": "z", "rule": "keep_out", "polygon": [[0, 0], [1, 1]]}),
        ("set_zone", {"name": "z", "rule": "keep_out", "polygon": [[0, 0], [1, 1], [2, 2]]}),
        ("set_zone", {"name": "z", "rule": "dance", "polygon": [[0, 0], [1, 0], [1, 1]]}),
        ("set_zone", {"name": "z", "rule": "slow", "speed": 0.0, "polygon": [[0, 0], [1, 0], [1, 1]]}),
        ("erase", {"polygon": [[0, 0], [1, 0], [float("inf"), 1]]}),
        ("erase", {"polygon": [[0, 0]] * 201}),
    ],
)
def test_impossible_requests_never_reach_the_chair(port: Noted, name: str, asked: dict[str, Any]) -> None:
    answer = obey(port, name, asked)
    assert not answer.done
    assert answer.sentence
    assert port.calls == []


def test_requests_reach_the_chair_unchanged(port: Noted) -> None:
    obey(port, "go", {"pose": [1, 2, 7.0]})
    obey(port, "confirm", {"goal": "elsewhere"})
    obey(port, "set_zone", {"name": "z", "rule": "one_way", "heading": -4.0, "polygon": [[0, 0], [1, 0], [1, 1]]})
    obey(port, "remove_zone", {"name": "z"})
    (pose,) = port.named("go")[0].asked
    assert pose == Pose2(1.0, 2.0, pytest.approx(7.0 - 2 * np.pi))
    assert port.named("confirm")[0].asked == ("elsewhere",)
    zone, replaces = port.named("set_zone")[0].asked
    assert not replaces
    assert isinstance(zone, Zone)
    assert (zone.rule, zone.value) == (Rule.ONE_WAY, pytest.approx(2 * np.pi - 4.0))


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)


class _Deaf:
    """No port: every call of it fails."""


@given(name=st.sampled_from(sorted(COMMANDS)) | st.text(max_size=12), asked=_JSON)
def test_every_command_is_answered(name: str, asked: object) -> None:
    answer = obey(_Deaf(), name, asked)  # type: ignore[arg-type]
    assert isinstance(answer, PortAnswer)
    assert not answer.done
    assert answer.sentence
