"""The page's token, port and process, and `waychair page`."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.page_process import page_addresses, page_token, port_of_page
from waychair.maps.drawn.places import load_places
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.ros.stack import Stack, processes
from waychair.runtime.processes import Process, Supervision
from waychair.types import Place, Pose2

COMMAND = (sys.executable, "-c", "from waychair.cli.main import main; main()", "page")
UI = pytest.mark.skipif(importlib.util.find_spec("fastapi") is None, reason="the extra [ui] is not installed")


def test_only_a_page_for_others_needs_a_token_and_gets_one() -> None:
    assert page_token(False, None) == ""
    made = {page_token(True, None) for _ in range(20)}
    assert len(made) == 20
    assert min(map(len, made)) >= 20


@given(st.text(max_size=20))
def test_a_token_can_stand_in_an_address_or_is_refused(text: str) -> None:
    fits = len(text) >= 12 and all(c.isascii() and (c.isalnum() or c in "-_") for c in text)
    if fits:
        assert page_addresses(8000, False, page_token(True, text)) == (f"http://127.0.0.1:8000/#token={text}",)
    else:
        with pytest.raises(BadArgument, match="--token"):
            page_token(True, text)


def test_a_taken_port_is_refused_if_it_was_requested_and_otherwise_another_is_found() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        with pytest.raises(BadArgument, match=f"--page-port {number} is taken"):
            port_of_page(number)
    assert port_of_page(number) == number
    with pytest.raises(BadArgument):
        port_of_page(70_000)
    assert 0 < port_of_page(None) < 65_536


@pytest.fixture
def served() -> Iterator[tuple[subprocess.Popen[str], int]]:
    port = port_of_page(None)
    process = subprocess.Popen([*COMMAND, "--port", str(port), "--no-people"], stderr=subprocess.PIPE, text=True)
    yield process, port
    process.kill()
    process.wait()


@pytest.mark.nightly
@UI
def test_a_simulated_chair_is_driven_by_its_page_and_ends_with_ctrl_c(
    served: tuple[subprocess.Popen[str], int],
) -> None:
    process, port = served
    answer: dict[str, object] = {}
    ends = time.monotonic() + 60.0
    while not answer and time.monotonic() < ends and process.poll() is None:
        time.sleep(0.2)
        try:
            request = urllib.request.Request(
                f"http://127.0.0.1:{port}/api/do/go", b'{"place": "ward"}', {"content-type": "application/json"}
            )
            with urllib.request.urlopen(request, timeout=5.0) as told:
                answer = json.load(told)
        except OSError:
            continue
    assert answer == {"done": True, "sentence": "press Drive to go to ward"}
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20.0)
    assert process.returncode == 0, said
    assert "research software, not a medical device" in said
    assert f"http://127.0.0.1:{port}/;" in said
    assert "Traceback" not in said


@UI
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--sim", "atlantis"), "there is no world"),
        pytest.param(("--map", "/nowhere"), "there is no map", marks=pytest.mark.nightly),
        pytest.param(("--token", "a"), "--token", marks=pytest.mark.nightly),
    ],
)
def test_an_impossible_request_gives_one_sentence(options: tuple[str, ...], said: str) -> None:
    told = subprocess.run([*COMMAND, *options], capture_output=True, text=True, timeout=60.0, check=False)
    assert told.returncode == 1
    assert said in told.stderr
    assert "Traceback" not in told.stderr


def test_the_chair_runs_without_the_page_process_and_announces_each_drive_to_it(tmp_path: Path) -> None:
    *others, page = processes(Stack(tmp_path, world="small_clinic", page_port=8123))
    assert (page.name, page.module, page.vital) == ("page", "waychair.cli.options.page_process", False)
    assert all(row.vital for row in others)
    assert "port: 8123" in (tmp_path / "page.yaml").read_text()
    assert "supervisor.countdown_s: 3.0" in (tmp_path / "bridge.yaml").read_text()
    processes(Stack(tmp_path, world="small_clinic"))
    assert "supervisor.countdown_s: 0.0" in (tmp_path / "bridge.yaml").read_text()


def test_drawings_on_a_worlds_own_plan_are_kept_for_the_next_run(tmp_path: Path) -> None:
    processes(Stack(tmp_path, world="small_clinic"))
    layout = DrawingEditor(tmp_path / "map")
    layout.set_place(Place("desk", Pose2(2.0, 1.0)))
    layout.erase(np.array([[5.0, 4.2], [5.6, 4.2], [5.6, 4.8], [5.0, 4.8]]))
    processes(Stack(tmp_path, world="small_clinic"))
    assert "desk" in load_places(tmp_path / "map")
    processes(Stack(tmp_path, world="second_floor"))
    assert "desk" not in load_places(tmp_path / "map")
    assert not DrawingEditor(tmp_path / "map").undoable
    assert DrawingEditor(tmp_path / "map").drawing.erased == ()


def test_the_other_processes_go_on_without_a_page_that_dies_repeatedly(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = (Process("page", "waychair.no_such_module", vital=False), Process("other", "http.server", ("0",)))
    said: list[str] = []
    monkeypatch.setattr("waychair.runtime.processes.MAX_DEATHS", 2)
    with Supervision(rows, dict(os.environ), said.append) as running:
        ends = time.monotonic() + 60.0
        while "page" in running.pids:
            assert running.watch() == ""
            assert time.monotonic() < ends
            time.sleep(0.05)
        assert "the others go on without it" in said[-1]
        assert running.watch() == ""
        assert set(running.pids) == {"other"}
