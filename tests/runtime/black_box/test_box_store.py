"""Parts on the disk: their numbers are unique and their count bounded, and open parts are not dropped."""

from __future__ import annotations

from pathlib import Path

from waychair.runtime.black_box.box_events import BlackBoxEvent, Gravity
from waychair.runtime.black_box.box_file import LogHeader
from waychair.runtime.black_box.box_store import BoxLimits, LogPart, PartStore, Segment, parts_of

HEAD = LogHeader("0123456789abcdef", 0, "0.1", "", {}, "", {})
SECOND_NS = 1_000_000_000


def opened(parts: PartStore, name: str, gravity: Gravity, segment: Segment) -> LogPart:
    """A part of one event, two seconds into the log."""
    event = BlackBoxEvent(name, f"{name}: do something", gravity, 2 * SECOND_NS, 0)
    return parts.open(event, HEAD, [segment], (0, 30 * SECOND_NS))


def segment_in(folder: Path) -> Segment:
    path = folder / "00000001.log"
    path.write_bytes(b"ticks")
    return Segment(path, 0, 3 * SECOND_NS, 5)


def names(folder: Path) -> list[str]:
    return [part.folder.name for part in parts_of(folder)]


def test_an_open_part_is_dropped_only_after_it_is_closed(tmp_path: Path) -> None:
    segment, parts = segment_in(tmp_path), PartStore(tmp_path, BoxLimits(10, 1_000_000, 2))
    parts.close(opened(parts, "first", Gravity.END, segment))
    pause = opened(parts, "pause", Gravity.PAUSE, segment)
    end = opened(parts, "end", Gravity.END, segment)
    assert names(tmp_path) == ["0001-first", "0002-pause", "0003-end"]
    later = Segment(tmp_path / "00000002.log", 3 * SECOND_NS, 4 * SECOND_NS, 5)
    later.path.write_bytes(b"more!")
    parts.keep(pause, [segment, later])
    parts.close(pause)
    assert names(tmp_path) == ["0001-first", "0003-end"]
    parts.close(end)
    assert names(tmp_path) == ["0001-first", "0003-end"]


def test_a_part_left_open_by_an_earlier_run_is_dropped_like_the_others(tmp_path: Path) -> None:
    segment, bounds = segment_in(tmp_path), BoxLimits(10, 1_000_000, 1)
    opened(PartStore(tmp_path, bounds), "left", Gravity.END, segment)
    parts = PartStore(tmp_path, bounds)
    parts.close(opened(parts, "new", Gravity.END, segment))
    assert names(tmp_path) == ["0002-new"]


def test_unreadable_folders_are_counted_and_no_number_is_used_twice(tmp_path: Path) -> None:
    segment, parts = segment_in(tmp_path), PartStore(tmp_path, BoxLimits(10, 1_000_000, 5))
    for left in ("0001-end", "0002-end", "notes"):
        (tmp_path / "parts" / left).mkdir()
    parts.close(opened(parts, "end", Gravity.END, segment))
    assert names(tmp_path) == ["0003-end"]
