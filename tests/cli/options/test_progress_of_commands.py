"""Commands that last tell how far they are on standard error, also where it is no terminal."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import waychair
from tests.cli.test_map_all import room_log
from tests.simulation.plan.test_imports import BARN
from waychair.cli.options import progress
from waychair.cli.options.page_process import port_of_page
from waychair.maps.drawn.places import add_place
from waychair.maps.folders.map_files import save_map
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.trials.travel.journey_runs import keep_record
from waychair.trials.travel.journeys import JourneyRecord
from waychair.types import OccupancyGrid, Odometry, Pose2, Scan

TOLD = re.compile(r"^([a-z -]+): (\d+ (s|min) so far|\d+ %)", re.MULTILINE)
"""A line about a stage, and its name."""

MAP = "type octile\nheight 3\nwidth 6\nmap\n......\n.@..@.\n......\n"
SCENARIO = "version 1\n" + "".join(f"0\tsmall.map\t6\t3\t{x}\t0\t{x}\t2\t2.0\n" for x in (0, 5))
JOURNEY = JourneyRecord("ground/lift", "upper/lift", True, "", 60.0, 0, 0, 0.0, 0, 1, (1.0,), 0.1, {"drive": 60.0})


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with small inputs: a map, a building of it, a benchmark map, recordings, a chair, a BARN world."""
    folder = tmp_path_factory.mktemp("files")
    cells = np.zeros((100, 160), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    save_map(folder / "hall", OccupancyGrid(cells, 0.05, Pose2(-1.0, -1.0)))
    for name, x in (("desk", 1.5), ("bed", 2.5)):
        add_place(folder / "hall", name, Pose2(x, 1.0, 0.0))
    (folder / "small.map").write_text(MAP)
    (folder / "small.scen").write_text(SCENARIO)
    room_log(folder / "room.log")
    _drive(folder / "drive.mcap")
    (folder / "barn").mkdir()
    (folder / "barn" / "world_007.txt").write_text(BARN)
    keep_record(folder / "kept.jsonl", "two_floors", 3, True, 0, JOURNEY)
    for arguments in (("new", "house", "--name", "House"), ("add", "house", "g", "--map", "hall")):
        done = waychair("building", *(str(folder / word) if word in ("house", "hall") else word for word in arguments))
        assert done.returncode == 0, done.stderr
    assert waychair("building", "generate", folder / "house", "g").returncode == 0
    return folder


def _drive(path: Path) -> None:
    """Write a bag of a drive with odometry through a hall of 10 by 6 m."""
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    with RecordingWriter(path, Pose2()) as writer, np.errstate(divide="ignore"):
        for k in range(60):
            x, c, s = 2.0 + 0.1 * k, np.cos(angles), np.sin(angles)
            ranges = np.minimum(np.where(c > 0, (10 - x) / c, -x / c), 3.0 / np.abs(s)).astype(np.float32)
            writer.write(Odometry(10**18 + k * 10**8, Pose2(x, 3.0, 0.0)))
            writer.write(Scan(10**18 + k * 10**8, ranges, -np.pi, np.pi / 90, range_max=30.0))


COMMANDS = {
    "navigate --map hall --goal desk --start 1.2,1": ["driving"],
    "guide --world apartment --goal kitchen --minutes 0.02": ["leading the rider"],
    "haptics learn --driver default --minutes 0.2": ["playing"],
    "building drive house --from desk --to bed": ["travelling"],
    "building generate house g": ["laying out the ways"],
    "building tables house": ["making the tables"],
    "plan --map small.map --scen small.scen": ["planning"],
    "plan --map hall --start desk --goal bed": ["planning"],
    "fleet solve small.map small.scen --agents 2 --seconds 0.2": ["solving"],
    "calibrate imu --seconds 20 --out chair.json": ["resting"],
    "calibrate mask --out chair.json": ["turning"],
    "map-all room.log --out maps": ["mapping"],
    "map drive.mcap --out map": ["checking", "mapping"],
    "localize drive.mcap --map map --start 0,0,0 --out found": ["checking", "localising"],
}
"""Commands with --quiet, and the stages that they tell."""

TALKATIVE = {
    "journeys --world two_floors --keep kept.jsonl --json": ["travelling"],
    "barn barn --jobs 1 --json": ["driving"],
    "building check house --json": ["checking"],
    "building bench house --queries 20 --json": ["dijkstra"],
    "fleet simulate I --seeds 1 --hours 0.2 --json": ["simulating"],
    "fleet simulate 4cross --planner order --rooms --bays 1 --hours 0.3 --seeds 1 --json": [
        "simulating",
        "trying the bays",
    ],
}
"""Commands without --quiet, whose standard output is JSON alone."""

OF_UNKNOWN_LENGTH = {
    "navigate --map hall --goal desk --start 1.2,1",
    "guide --world apartment --goal kitchen --minutes 0.02",
    "building drive house --from desk --to bed",
    "plan --map hall --start desk --goal bed",
    "building check house --json",
    "journeys --world two_floors --keep kept.jsonl --json",
}
"""Commands that tell no share, or have nothing left to do."""

IN_OTHER_PROCESSES = {"map-all room.log --out maps"}
"""Commands that run no kernel themselves."""


def _run(files: Path, command: str, *more: str) -> tuple[str, str]:
    """Return standard output and error of a command, whose words that name files mean those in the folder."""
    known = {path.name for path in files.iterdir()} | {"map", "maps", "found", "chair.json"}
    first, *words = command.split()
    done = waychair(first, *(str(files / word) if word in known else word for word in words), *more)
    assert done.returncode == 0 or "the time limit was reached" in done.stderr, done.stderr
    return done.stdout, done.stderr


def _announcements() -> int:
    """Return how often it has been asked for that the first compilation is announced."""
    asked = progress._announce_compiling.cache_info()
    return asked.hits + asked.misses


def _stages(text: str) -> list[str]:
    return [found[0] for found in TOLD.findall(text)]


@pytest.mark.parametrize(("command", "stages"), [*COMMANDS.items(), *TALKATIVE.items()])
def test_a_command_that_lasts_tells_its_stages_on_standard_error_alone(
    files: Path, monkeypatch: pytest.MonkeyPatch, command: str, stages: Sequence[str]
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    began = _announcements()
    said, told = _run(files, command)
    assert set(stages) <= set(_stages(told)), told[-2000:]
    if command not in OF_UNKNOWN_LENGTH:
        assert set(stages) <= {found[1] for found in re.finditer(r"^(.+): \d+ %", told, re.MULTILINE)}, told[-2000:]
    assert not TOLD.search(said)
    assert (_announcements() > began) == (command not in IN_OTHER_PROCESSES)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_quiet_command_tells_no_stage(files: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    began = _announcements()
    said, told = _run(files, command, "--quiet")
    assert (said, _stages(told)) == ("", [])
    assert _announcements() == began


@pytest.mark.skipif(importlib.util.find_spec("fastapi") is None, reason="the extra [ui] is not installed")
def test_the_page_tells_how_long_its_chair_takes_to_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    monkeypatch.setattr("waychair.runtime.processes.signalled", lambda *_: lambda: True)  # as if Ctrl-C came at once
    done = waychair("page", "--sim", "table", "--port", str(port_of_page(None)))
    assert done.returncode == 0, done.stderr
    assert set(_stages(done.stderr)) == {"starting the chair"}
    *_, last = done.stderr.splitlines()
    assert "end with Ctrl-C" in last
    assert done.stdout == ""
