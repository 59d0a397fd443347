"""A recorded drive through each single part of a chair gives the reference outputs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from evaluation.runs.part_replays import part_replays
from evaluation.runs.replay import (
    IGNORED,
    TOLERANCES,
    Row,
    Tape,
    TapedTick,
    differences,
    load_reference,
    load_tape,
    save_reference,
    save_tape,
)

from tests.replay.scene import setup, taped
from waychair.errors import BoxError, ConfigError
from waychair.types import Pose2

HERE = Path(__file__).resolve().parent
TAPE = HERE / "drive.tape"
PARTS = ("odometry", "localiser", "pilot", "base")


def reference_of(part: str) -> Path:
    return HERE / "references" / f"{part}.json.xz"


@pytest.fixture(scope="module")
def tape(request: pytest.FixtureRequest) -> Tape:
    if request.config.getoption("--record", False):
        save_tape(TAPE, taped())
    return load_tape(TAPE)


@pytest.fixture(scope="module")
def outputs(tape: Tape) -> Callable[[str], list[Row]]:
    """The present outputs of a part, replayed once."""
    return cache(lambda part: part_replays(setup())[part](tape))


@pytest.mark.parametrize("part", PARTS)
def test_the_outputs_of_a_part_equal_the_reference(
    part: str, outputs: Callable[[str], list[Row]], request: pytest.FixtureRequest
) -> None:
    rows = outputs(part)
    if request.config.getoption("--update", False) or request.config.getoption("--record", False):
        save_reference(reference_of(part), part, rows, str(request.config.getoption("--reason")))
    found = differences(part, load_reference(reference_of(part)).rows, rows)
    listed = "\n".join(map(str, found))
    advice = (
        'if it is meant, run: pytest tests/replay --update --reason "why"; where the board or the sensors speak '
        "otherwise now, --record instead of --update"
    )
    assert not found, f"{listed}\n{advice}"


def test_the_recording_holds_all_inputs_of_a_drive(tape: Tape) -> None:
    ticks = [moment.tick for _, moment in tape.moments()]
    assert {tick.mode.value for tick in ticks} == {"manual", "autonomous", "stopped"}
    assert {"driving", "waiting", "failed"} <= {tick.stage for tick in ticks}
    assert any(tick.sent.active for tick in ticks)
    kinds = {type(message).__name__ for _, moment in tape.moments() for message in moment.heard}
    assert kinds == {"Scan", "WheelTicks", "ImuSample"}


def test_the_base_alone_repeats_its_outputs_of_the_drive(tape: Tape, outputs: Callable[[str], list[Row]]) -> None:
    for row, (_, moment) in zip(outputs("base"), tape.moments(), strict=True):
        tick = moment.tick
        assert (row["mode"], row["active"]) == (tick.mode.value, tick.sent.active)
        assert row["forward_volts"] == pytest.approx(tick.sent.forward_volts, abs=0.02)


def changed_limiter() -> Callable[[Tape], list[Row]]:
    here = setup()
    limiter = replace(here.chair.limiter, jerk=0.8 * here.chair.limiter.jerk)
    return part_replays(replace(here, chair=replace(here.chair, limiter=limiter)))["base"]


def test_a_change_is_named_by_part_field_row_and_both_values(tape: Tape) -> None:
    old = load_reference(reference_of("base")).rows
    found = differences("base", old, changed_limiter()(tape))
    first = found[0]
    assert first.field in ("v", "omega", "forward_volts")
    assert 50 < first.row < 80  # the start of the drive
    assert str(first).startswith(f"base: {first.field} was {first.old} and is {first.new} in row {first.row}")
    assert not {"mode", "halts"} & {difference.field for difference in found}


def test_numbers_within_the_tolerance_are_equal_and_beyond_it_are_not() -> None:
    old: list[Row] = [{"x": 1.0, "health": 0.5, "state": "ok", "jumped": False}]
    limit = TOLERANCES["localiser"]
    assert differences("localiser", old, [{**old[0], "x": 1.0 + 0.9 * limit}]) == []
    assert [d.field for d in differences("localiser", old, [{**old[0], "x": 1.0 + 1.1 * limit}])] == ["x"]
    assert [d.field for d in differences("localiser", old, [{**old[0], "state": "lost"}])] == ["state"]
    assert [d.field for d in differences("localiser", old, [{**old[0], "jumped": True}])] == ["jumped"]
    assert [d.field for d in differences("localiser", old, [{**old[0], "x": None}])] == ["x"]


def test_only_the_listed_fields_are_ignored() -> None:
    old: list[Row] = [{"reason": "a", "stage": "driving"}]
    assert differences("pilot", old, [{"reason": "b", "stage": "driving"}]) == []
    assert [d.field for d in differences("pilot", old, [{"reason": "b", "stage": "failed"}])] == ["stage"]
    assert all(reason for reason in IGNORED.values())


def test_a_missing_or_new_field_or_row_counts_as_a_difference() -> None:
    old: list[Row] = [{"x": 1.0}, {"x": 2.0}]
    assert [d.field for d in differences("base", old, [{"x": 1.0, "y": 0.0}, {"x": 2.0, "y": 0.0}])] == ["y"]
    assert [d.field for d in differences("base", old, old[:1])] == ["rows"]


def test_a_reference_keeps_every_reason_that_it_was_rewritten_for(tmp_path: Path) -> None:
    path = tmp_path / "odometry.json.xz"
    save_reference(path, "odometry", [{"x": 1.0}], "the first one")
    save_reference(path, "odometry", [{"x": 2.0}], "wheels are wider")
    reference = load_reference(path)
    assert reference.reasons == ("the first one", "wheels are wider")
    assert reference.rows == ({"x": 2.0},)


def test_a_reference_is_not_rewritten_without_a_reason(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--reason"):
        save_reference(tmp_path / "base.json.xz", "base", [{"x": 1.0}], "  ")
    assert list(tmp_path.iterdir()) == []


def test_pytest_refuses_to_update_without_a_reason() -> None:
    before = {path: path.read_bytes() for path in (HERE / "references").iterdir()}
    command = [sys.executable, "-m", "pytest", str(HERE), "--update", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=HERE.parent.parent)
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert "without a reason" in done.stderr
    assert {path: path.read_bytes() for path in (HERE / "references").iterdir()} == before


def test_a_recording_of_another_version_is_named() -> None:
    strange = TapedTick((), b"", (), False, b"something else", None)
    with pytest.raises(BoxError, match="another version"):
        list(Tape(Pose2(), (strange,)).moments())


@pytest.mark.parametrize("content", [b"", b"no tape", b"\xfd7zXZ\x00\x00"])
def test_a_damaged_recording_or_reference_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(content)
    with pytest.raises(BoxError, match="tape"):
        load_tape(path)
    with pytest.raises(BoxError, match="reference"):
        load_reference(path)


def test_the_references_are_small_and_carry_a_reason() -> None:
    files = [TAPE, *map(reference_of, PARTS)]
    assert sum(path.stat().st_size for path in files) < 400_000
    for part in PARTS:
        reference = load_reference(reference_of(part))
        assert reference.part == part
        assert reference.reasons
