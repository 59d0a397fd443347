"""The demo on a page: visitors see it run and can stop it."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.halls import mapped_hall
from waychair.runtime.chair import ChairState
from waychair.runtime.pages.chair_port import ChairView
from waychair.slam.localising.localisation import LocalisationState
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.trials.demo.demo import run_demo
from waychair.trials.demo.demo_page import DemoPage
from waychair.types import UNKNOWN, DriveMode, Scan, SensorMessage

PLAN = mapped_hall("  door: [2.0, 3.0, 3.1]\n  window: [6.0, 3.6, 0.0]\n")


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "hall.yaml"
    path.write_text(PLAN, encoding="utf-8")
    return path


class Onlooker(DemoPage):
    """A page that collects all views, and stops the drive to one place once the chair moves."""

    def __init__(self, stops: str = "") -> None:
        super().__init__(views_s=0.0, grids_s=0.0)  # every view, on any computer
        self.seen: list[ChairView] = []
        self._stops = stops

    def tick_ended(self, messages: Sequence[SensorMessage], state: ChairState) -> None:
        super().tick_ended(messages, state)
        self.seen.append(self.view())
        if state.navigation.twist.v > 0.1 and self.view().goal == self._stops:
            assert self.stop().done


@pytest.mark.nightly
def test_a_page_sees_the_map_grow_and_the_chair_drive_to_each_place(plan: Path, tmp_path: Path) -> None:
    known = []

    class OfMapping(Onlooker):
        def scan_mapped(self, live: LiveMapping, scan: Scan) -> None:
            super().scan_mapped(live, scan)
            grid = self.grid()
            assert grid is not None
            known.append(int((grid.cells != UNKNOWN).sum()))
            assert self.view().mode is DriveMode.MANUAL
            assert "by joystick" in self.view().next_action

    page = OfMapping()
    demo = run_demo(tmp_path / "demo", seed=1, world=plan, surprises=False, watcher=page)
    assert [leg.reached for leg in demo.legs] == [True, True]
    assert known[-1] > 1.02 * known[0] > 0
    assert set(page.layout().places) == {"door", "window"}
    goals = [view.goal for view in page.seen if view.goal]
    assert list(dict.fromkeys(goals)) == ["door", "window"]
    driving = [view for view in page.seen if view.mode is DriveMode.AUTONOMOUS]
    assert all(view.localisation is LocalisationState.OK and len(view.scan) > 50 for view in driving)
    assert any(len(view.path) for view in driving)
    assert page.seen[-1].last_stop == "Arrived at window."
    assert np.array_equal(page.grid().cells, demo.setup.grid.cells)  # type: ignore[union-attr]


@pytest.mark.nightly
def test_stop_ends_the_drive_and_all_later_ones(plan: Path, tmp_path: Path) -> None:
    page = Onlooker(stops="door")
    demo = run_demo(tmp_path / "demo", seed=1, world=plan, surprises=False, watcher=page)
    (leg,) = demo.legs
    assert leg.place == "door"
    assert not leg.reached
    assert "Stop was pressed" in leg.reason
    assert abs(leg.commands[-1]).max() == 0.0
    assert leg.error_m > 0.5
    assert page.stop_requested


def test_requests_that_a_demo_does_not_support_give_one_sentence_each() -> None:
    page = DemoPage()
    refused = [page.go("door"), page.confirm(), page.steer(1.0, 0.0), page.undo(), page.relocalise()]
    assert not any(answer.done for answer in refused)
    assert all("waychair page" in answer.sentence for answer in refused)
    assert page.stop().done
    assert page.stop_requested


@pytest.mark.nightly
def test_the_command_serves_the_page_while_it_runs(plan: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from waychair.cli.main import main; main()", "demo", "--world", str(plan)]
    command += ["--no-surprises", "--out", str(tmp_path / "demo")]
    wide = {**os.environ, "COLUMNS": "200"}
    with subprocess.Popen(command, env=wide, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        address = re.search(r"http://127\.0\.0\.1:\d+/", running.stderr.readline())
        assert address is not None
        page, ends = "", time.monotonic() + 20.0
        while not page and time.monotonic() < ends:
            with contextlib.suppress(OSError):
                page = urllib.request.urlopen(address[0], timeout=5.0).read().decode()
        assert "Stop" in page
        running.stderr.read()
    assert running.returncode == 0
    assert json.loads((tmp_path / "demo" / "report.json").read_text())["goals_reached"] == 2
