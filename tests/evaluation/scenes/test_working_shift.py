"""Working shifts: their figures, and their sum over several calls."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Self

import msgspec
import pytest
from evaluation.figures.driving import nights as module
from evaluation.figures.driving.nights import nights
from evaluation.scenes.working_shift import Shift, run_shift

from tests.halls import hall_plan

PLAN = hall_plan(
    9.0,
    6.0,
    """\
  - {start: [4.5, 0.0], end: [4.5, 6.0], doors: [{name: south, at: 1.5, width: 1.4}, {name: north, at: 4.5, width: 1.4}]}
places:
  window: [7.0, 3.6, 0.0]
""",
)


@pytest.fixture(scope="module")
def shift(tmp_path_factory: pytest.TempPathFactory) -> Shift:
    plan = tmp_path_factory.mktemp("shift") / "hall.yaml"
    plan.write_text(PLAN, encoding="utf-8")
    return run_shift(str(plan), seed=4, seconds=60.0, people=1)


@pytest.mark.nightly
def test_a_shift_lasts_as_long_as_requested_and_has_one_drive_after_the_other(shift: Shift) -> None:
    assert shift.seconds >= 60.0
    assert shift.drives >= 2
    assert shift.reached == shift.drives - len(shift.failures)
    assert shift.way_m > 4.0
    assert shift.at_fault == 0


@pytest.mark.nightly
def test_only_a_door_with_a_detour_is_closed(shift: Shift) -> None:
    assert shift.shut in ("south", "north")
    assert shift.reached > 0


@pytest.mark.nightly
def test_nights_are_summed_over_calls_and_each_shift_is_driven_once(
    shift: Shift, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(3):
        hit = replace(shift, seed=number, struck={"bumped": 2} if number else {})
        written = {"commit": f"c{number}", "shift": hit}
        (tmp_path / f"{number}.json").write_bytes(msgspec.json.encode(written))
    driven: list[int] = []

    def add(folder: Path, shift_s: float, number: int) -> str:
        driven.append(number)
        written = {"commit": "now", "shift": replace(shift, seed=number, struck={"person": 1})}
        (folder / f"{number}.json").write_bytes(msgspec.json.encode(written))
        return ""

    class Here:
        """A pool that runs in this process, so that the test sees the drives."""

        def __init__(self, *_: object) -> None:
            self.map = map

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(module, "_add", add)
    monkeypatch.setattr(module, "figure_pool", Here)
    before = nights(tmp_path / "nights.json", 1.0, tmp_path, 3600.0)
    assert driven == [3]
    assert (before["shifts"], before["contacts_by_the_chair"], before["walked_into_the_chair"]) == (4, 1, 4)
    assert not before["passed"]
    assert before["commits"] == ["c0", "c1", "c2", "now"]
    (tmp_path / "3.json").unlink()
    assert nights(tmp_path / "nights.json", 0.01, tmp_path, 36.0)["shifts"] == 4
    assert driven == [3, 3]
