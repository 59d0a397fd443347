"""A chair's drives in a building's folder teach it how long its arcs take, after the rider's yes."""

from __future__ import annotations

import json
import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.maps.building.buildings import two_storeys
from tests.planning.building.test_learnt_drives import drive
from waychair.control.drive.navigator import Stage
from waychair.maps.building.hgraph_files import write_hgraph
from waychair.planning.building.learnt_drives import DRIVES
from waychair.runtime.drive_times import DriveTimes


def driven(folder: Path, *, wanted: bool = True, end: Stage = Stage.ARRIVED, storeys: str = "g") -> list[str]:
    """Step through a drive along the corridor whose last tick has the stage `end`; return what was learnt, as it came.

    `storeys`: one for each part of the drive of equal length.
    """
    learnt: list[str] = []
    stamps, poses = drive((3.0, 0.0), (10.0, 0.0))
    with ThreadPoolExecutor(1) as worker:
        times = DriveTimes(folder, lambda: wanted, worker, lambda: learnt.append("learnt"))
        for k, (stamp, (x, y)) in enumerate(zip(stamps.tolist(), poses.tolist(), strict=True)):
            last = k == len(stamps) - 1
            state: Any = SimpleNamespace(
                stamp_ns=stamp,
                map_from_base=SimpleNamespace(x=x, y=y),
                verdict=SimpleNamespace(computer_drives=not last, steered=False),
                navigation=SimpleNamespace(stage=end if last else Stage.DRIVING),
            )
            times.step(state, storeys[k * len(storeys) // len(stamps)])
    return learnt


def test_a_drive_that_arrived_is_learnt_from_once(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    assert driven(tmp_path) == ["learnt"]
    assert {key: [pytest.approx(10.0, abs=0.3)] for key in ("g:c1>c2",)}.items() <= kept(tmp_path).items()


@pytest.mark.parametrize("changes", [{"wanted": False}, {"end": Stage.FAILED}, {"storeys": "g1"}])
def test_no_drive_teaches_without_a_yes_or_an_arrival_or_over_a_change_of_storey(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    write_hgraph(tmp_path, two_storeys())
    assert driven(tmp_path, **changes) == []
    assert not (tmp_path / DRIVES).exists()


def test_a_building_that_cannot_be_read_is_told_and_ends_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.ERROR):
        assert driven(tmp_path / "gone") == []
    assert "the drive's times were not learnt" in caplog.text


def kept(folder: Path) -> dict[str, list[float]]:
    return dict(json.loads((folder / DRIVES).read_text()))
