"""Lines of a log that are doubled, or sorted otherwise, are put in order; jitter of stamps is not."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.recordings.text.carmen import read_carmen

STAMPS = [100.0 + 0.2 * k for k in range(40)]


def log(stamps: list[float], digits: int = 0) -> bytes:
    """Return a log with a scan at each stamp, in seconds times a power of ten."""
    rows = []
    for stamp in stamps:
        ranges = " ".join(f"{3.0 + 0.01 * np.sin(stamp * beam):.4f}" for beam in range(1, 6))
        told = f"{stamp * 10**digits:.0f}" if digits else f"{stamp:.6f}"
        rows.append(f"FLASER 5 {ranges} {stamp} 0 0 {stamp} 0 0 {told} host {told}\n")
    return "".join(rows).encode()


def test_a_log_from_its_end_to_its_beginning_is_put_in_order() -> None:
    found = read_carmen(log(STAMPS[::-1]), "log")
    assert [frame.stamp_ns for frame in found.frames] == [round(stamp * 1e9) for stamp in STAMPS]
    assert found.warnings == ("39 scan lines are not in the order of their stamps: they were sorted",)


def test_two_lines_that_were_exchanged_go_back_to_their_places() -> None:
    stamps = [100.0 + 0.2 * k for k in range(80)]
    moved = [*stamps[:20], stamps[60], *stamps[21:60], stamps[20], *stamps[61:]]
    found = read_carmen(log(moved), "log")
    assert [frame.stamp_ns for frame in found.frames] == [round(stamp * 1e9) for stamp in stamps]
    assert found.warnings == (
        "2 scan lines are far from the place of their stamps, where lines are missing: they were put there",
    )


def test_doubled_lines_are_left_out() -> None:
    found = read_carmen(log(STAMPS[:20] + STAMPS[10:]), "log")
    assert len(found.frames) == 40
    assert found.warnings == ("10 scan lines are there twice: their copies are left out",)


def test_scans_whose_stamps_stand_still_are_no_copies_of_each_other() -> None:
    rows = [f"FLASER 5 3 3 3 3 {3.0 + 0.001 * k:.4f} {k} 0 0 {k} 0 0 7.0 host 7.0\n" for k in range(3000)]
    found = read_carmen("".join([*rows, *rows[:2]]).encode(), "log")
    assert len(found.frames) == 3000
    assert found.warnings == ("2 scan lines are there twice: their copies are left out",)


@pytest.mark.parametrize(
    "stamps", [[*STAMPS[:9], STAMPS[9] - 1.05, *STAMPS[10:]], [*STAMPS, *(stamp + 0.01 for stamp in STAMPS[:8])]]
)
def test_single_odd_stamps_and_a_clock_that_is_set_back_keep_the_order(stamps: list[float]) -> None:
    found = read_carmen(log(stamps), "log")
    assert [frame.stamp_ns for frame in found.frames] == [round(stamp * 1e9) for stamp in stamps]
    assert found.warnings == ("stamps step backwards 1 times: the scans are kept in the order of the file",)


@pytest.mark.parametrize(("digits", "unit"), [(3, "milliseconds"), (6, "microseconds"), (9, "nanoseconds")])
def test_stamps_since_1970_in_a_smaller_unit_are_read_in_it(digits: int, unit: str) -> None:
    stamps = [1_700_000_000.0 + stamp for stamp in STAMPS]
    found = read_carmen(log(stamps, digits), "log")
    assert len(found.frames) == 40
    assert abs(found.frames[0].stamp_ns - round(stamps[0] * 1e9)) < 1_000_000
    assert found.warnings == (f"the stamps of log are read as {unit}",)
