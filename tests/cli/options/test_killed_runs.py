"""Mapping runs that are killed or interrupted at any moment: the same command goes on, and its map is that of a whole run."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import WAYCHAIR, waychair
from waychair import config
from waychair.offline.mapping import MappingSettings

RESULTS = ("trajectory.tum", "map.pgm", "map.yaml", "graph.g2o", "config.yaml")
OTHERS = ("report.json", "report.html", "session.npz")
MOMENTS = np.random.default_rng(30).uniform(0.1, 1.0, (6, 2)).tolist()  # shares of the time of a whole run


@dataclass(frozen=True)
class WholeRun:
    """The command up to its output folder, the folder of its undisturbed run, and that run's time [s]."""

    command: tuple[str, ...]
    folder: Path
    seconds: float

    def begun(self, folder: Path) -> subprocess.Popen[str]:
        return subprocess.Popen([str(WAYCHAIR), *self.command, str(folder)], stderr=subprocess.PIPE, text=True)

    def ended(self, folder: Path) -> int:
        """End the run in a folder, compare its map with that of the undisturbed one, and return the frame it went on from."""
        assert waychair(*self.command, folder).returncode == 0
        for name in RESULTS:
            assert (folder / name).read_bytes() == (self.folder / name).read_bytes(), name
        assert {path.name for path in folder.iterdir()} == {*RESULTS, *OTHERS}
        return int(json.loads((folder / "report.json").read_text())["resumed_at_frame"])


@pytest.fixture(scope="module")
def whole(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> WholeRun:
    folder = tmp_path_factory.mktemp("runs")
    config.save(MappingSettings(checkpoint_interval=0.0), folder / "often.yaml")
    log = data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz"
    command = "map", str(log), "--config", str(folder / "often.yaml"), "--quiet", "--out"
    run, started = WholeRun(command, folder / "whole", 0.0), time.monotonic()
    assert run.begun(run.folder).wait() == 0
    assert json.loads((run.folder / "report.json").read_text())["resumed_at_frame"] == 0
    return WholeRun(command, run.folder, time.monotonic() - started)


def stop(running: subprocess.Popen[str], how: signal.Signals, when: Callable[[], bool]) -> tuple[int, str]:
    """Stop a run as soon as a moment has come; return its exit code and what it said."""
    while running.poll() is None and not when():
        time.sleep(0.002)
    running.send_signal(how)
    return running.wait(), running.communicate()[1]


def after(seconds: float) -> Callable[[], bool]:
    end = time.monotonic() + seconds
    return lambda: time.monotonic() >= end


@pytest.mark.nightly
@pytest.mark.parametrize("moments", MOMENTS)
def test_a_run_that_is_killed_twice_at_any_moments_gives_the_same_map(
    whole: WholeRun, tmp_path: Path, moments: list[float]
) -> None:
    for moment in moments:
        code, _ = stop(whole.begun(tmp_path), signal.SIGKILL, after(moment * whole.seconds))
        assert code in (-signal.SIGKILL, 0)
    was_kept = (tmp_path / "checkpoint.npz").exists()
    assert (whole.ended(tmp_path) > 0) == was_kept


@pytest.mark.nightly
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_stopped_after_its_first_checkpoint_goes_on_from_there(
    whole: WholeRun, tmp_path: Path, how: signal.Signals
) -> None:
    checkpoint = tmp_path / "checkpoint.npz"
    code, told = stop(whole.begun(tmp_path), how, checkpoint.exists)
    if how is signal.SIGINT:
        assert (code, told) == (130, "waychair: stopped; run the same command again to resume from its checkpoint\n")
    else:
        assert (code, told) == (-signal.SIGKILL, "")
    assert checkpoint.exists()
    assert not (tmp_path / "map.yaml").exists()
    assert whole.ended(tmp_path) > 0


@pytest.mark.nightly
def test_a_run_that_is_killed_while_it_saves_gives_the_same_map(whole: WholeRun, tmp_path: Path) -> None:
    code, _ = stop(whole.begun(tmp_path), signal.SIGKILL, lambda: any(tmp_path.glob(".together.*/*")))
    assert code == -signal.SIGKILL, "the run was over before it could be killed"
    assert whole.ended(tmp_path) > 0
