"""The black box: always on, bounded, never blocking, and readable after a crash."""

from __future__ import annotations

import errno
import itertools
import logging
import os
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.runtime.boxes import LOGGED_CHAIR, Drive, driven, logged, wait_for
from tests.runtime.riding import Ride
from tests.runtime.test_chair_faults import only
from waychair.calibration.calibration_file import content_hash, load_calibration
from waychair.config import load
from waychair.control.safety.supervisor import DRIVEN
from waychair.errors import BoxError
from waychair.firmware_bridge.protocol import FIRMWARE_VERSION, LAYOUT_HASH
from waychair.runtime.black_box import box_store as black_box_store
from waychair.runtime.black_box import recorder as black_box
from waychair.runtime.black_box.box_events import EventDetector
from waychair.runtime.black_box.box_file import Moment, read_log, tick_from_state
from waychair.runtime.black_box.box_store import is_written, parts_of, segment_files
from waychair.runtime.black_box.recorder import BlackBox, BlackBoxSettings
from waychair.runtime.chair import ChairSettings
from waychair.types import ImuSample, RgbdFrame, WheelTicks

SHORT = BlackBoxSettings(ring_minutes=1.0, before_s=10.0, after_s=10.0)


@pytest.fixture
def short_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of 5 s, so that a ring of a minute has a dozen."""
    monkeypatch.setattr(black_box, "SEGMENT_S", 5.0)


def stopped_by_the_lidar(ride: Ride) -> None:
    ride.drive(90)
    ride.change = only(WheelTicks)
    ride.tick(30)


@pytest.fixture(scope="module")
def stopped() -> Drive:
    """A drive that a silent lidar ends, and a second at rest after it."""
    return driven(stopped_by_the_lidar).without_first(4)


@pytest.fixture(scope="module")
def quiet(stopped: Drive) -> Drive:
    """The part of the drive without events."""
    return Drive({}, stopped.notes[1:46])


def test_messages_requests_and_ticks_are_logged_in_order(stopped: Drive, tmp_path: Path) -> None:
    box = logged(tmp_path, [stopped])
    log = read_log(segment_files(tmp_path))
    assert (box.lost, box.problem, log.lost, log.damaged) == (0, "", 0, 0)
    assert [tick.stamp_ns for tick in log.ticks] == [state.stamp_ns for _, state, _ in stopped.notes]
    heard = [message for messages, _, _ in stopped.notes for message in messages]
    assert [(type(m), m.stamp_ns) for m in log.messages()] == [(type(m), m.stamp_ns) for m in heard]
    for tick, (_, state, _) in zip(log.ticks, stopped.notes, strict=True):
        assert (tick.map_from_base, tick.command, tick.sent) == (state.map_from_base, state.command, state.sent)
        assert [halted.id for halted in tick.halts] == [halted.stop.id for halted in state.halts]
        assert tick.stage == state.navigation.stage.value
    assert [told.what for _, told in log.requests] == ["go", "confirm"]
    assert log.end is not None


def test_a_log_names_its_chair(stopped: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [stopped])
    part = parts_of(tmp_path)[-1]
    assert load(ChairSettings, part.folder / "configuration.yaml") == LOGGED_CHAIR.configuration
    assert load_calibration(part.folder / "calibration.json") == LOGGED_CHAIR.calibration
    assert part.calibration_hash == content_hash(LOGGED_CHAIR.calibration)
    assert part.board["firmware_version"] == FIRMWARE_VERSION
    assert part.board["layout_hash"] == LAYOUT_HASH
    assert part.software


@pytest.mark.usefixtures("short_segments")
def test_the_ring_is_bounded_and_drops_the_oldest_files(quiet: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [quiet] * 60, SHORT)
    files = segment_files(tmp_path)
    log = read_log(files)
    last_ns = log.ticks[-1].stamp_ns
    assert len(files) <= 60 / 5 + 1
    assert 55.0 <= (last_ns - log.ticks[0].stamp_ns) * 1e-9 <= 66.0
    assert (log.lost, log.damaged) == (0, 0)


@pytest.mark.usefixtures("short_segments")
def test_the_ring_is_bounded_in_bytes_too(quiet: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [quiet] * 40, replace(SHORT, ring_mb=1))
    assert sum(path.stat().st_size for path in segment_files(tmp_path)) <= 1_100_000
    assert read_log(segment_files(tmp_path)).damaged == 0


@pytest.mark.usefixtures("short_segments")
def test_a_stop_keeps_the_log_before_and_after_it(stopped: Drive, quiet: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [quiet] * 10 + [stopped] + [quiet] * 10, SHORT)
    part = next(part for part in parts_of(tmp_path) if any(event.id == "lidar_stale" for event in part.events))
    assert part.closed
    stop = next(event for event in part.events if event.id == "lidar_stale")
    stamps = [tick.stamp_ns for tick in part.log().ticks]
    assert stamps[0] <= part.events[0].stamp_ns - 9.5e9
    assert stamps[-1] >= stop.stamp_ns + 9.5e9
    assert stamps[-1] - stamps[0] <= 22e9
    assert len(stamps) == len(set(stamps))


@pytest.mark.usefixtures("short_segments")
def test_a_part_is_kept_longer_than_the_ring(stopped: Drive, quiet: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [stopped] + [quiet] * 50, SHORT)
    part = next(part for part in parts_of(tmp_path) if any(event.id == "lidar_stale" for event in part.events))
    ring = {path.stat().st_ino for path in segment_files(tmp_path)}
    assert not ring & {path.stat().st_ino for path in part.folder.glob("*.log")}
    assert any(halted.id == "lidar_stale" for tick in part.log().ticks for halted in tick.halts)


@pytest.mark.usefixtures("short_segments")
def test_parts_are_kept_without_hard_links(
    stopped: Drive, quiet: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", refused)
    logged(tmp_path, [stopped] + [quiet] * 50, SHORT)
    part = next(part for part in parts_of(tmp_path) if any(event.id == "lidar_stale" for event in part.events))
    log = part.log()
    assert log.damaged == 0
    assert log.ticks[-1].stamp_ns >= part.events[-1].stamp_ns + 9.5e9


@pytest.mark.usefixtures("short_segments")
def test_the_number_of_parts_is_bounded_and_the_newest_and_those_read_stay(
    stopped: Drive, quiet: Drive, tmp_path: Path
) -> None:
    few = replace(SHORT, parts=3)
    logged(tmp_path, [stopped, quiet], few)
    first = parts_of(tmp_path)[0]
    first.mark_read()
    for _ in range(4):
        logged(tmp_path, [stopped, quiet], few)
    kept = [part.number for part in parts_of(tmp_path)]
    assert len(kept) == 3
    assert first.number in kept
    assert max(kept) == 5


def test_consequences_of_a_stop_belong_to_its_part_and_the_next_drive_does_not(
    stopped: Drive, quiet: Drive, tmp_path: Path
) -> None:
    logged(tmp_path, [stopped, stopped, quiet])
    parts = parts_of(tmp_path)
    assert [[event.id for event in part.events] for part in parts] == [["lidar_late", "lidar_stale"]] * 2


def test_a_drive_that_ends_at_once_has_its_own_stop(stopped: Drive, tmp_path: Path) -> None:
    driven = [state.verdict.mode in DRIVEN for _, state, _ in stopped.notes]
    begun, ended = driven.index(True), len(driven) - driven[::-1].index(True)
    short = Drive({}, [*stopped.notes[: begun + 3], *stopped.notes[ended - 3 :]])
    logged(tmp_path, [stopped, short])
    first, second = parts_of(tmp_path)
    assert second.events[0].stamp_ns - first.events[-1].stamp_ns < 30_000_000_000
    assert [event.id for event in second.events] == ["lidar_late", "lidar_stale"]


def test_a_process_that_reports_a_drives_end_later_makes_no_second_end(stopped: Drive) -> None:
    """As the navigator does, where it is a process of its own."""
    states = [state for _, state, _ in stopped.notes]
    ended = next(k for k, state in enumerate(states) if k and not state.verdict.computer_drives and state.verdict.halt)
    before, at = states[ended - 1], states[ended]
    lagging = replace(at, navigation=before.navigation)
    late = replace(at, stamp_ns=at.stamp_ns + 30_000_000, verdict=replace(at.verdict, drops_goal=False))
    much_later = replace(late, stamp_ns=at.stamp_ns + 900_000_000)
    watch = EventDetector()
    told = [
        [event.id for event in watch.update(Moment(tick_from_state(state, 0)))] for state in (before, lagging, late)
    ]
    assert told[1:] == [["lidar_stale"], []]
    watch.update(Moment(tick_from_state(before, 0)))
    assert [event.id for event in watch.update(Moment(tick_from_state(much_later, 0)))] == ["lidar_stale"]


def test_a_jolt_is_an_event(quiet: Drive, tmp_path: Path) -> None:
    heard, state, board = quiet.notes[-1]
    knock = ImuSample(state.stamp_ns, np.array([-20.0, 3.0, 9.8]), np.zeros(3))
    lean = ImuSample(state.stamp_ns, np.array([3.0, 0.0, 9.3]), np.zeros(3))
    knocked = Drive({}, [*quiet.notes[:-1], ((*heard, knock), state, board)])
    logged(tmp_path / "a", [Drive({}, [*quiet.notes[:-1], ((*heard, lean), state, board)])])
    assert parts_of(tmp_path / "a") == []
    logged(tmp_path / "b", [knocked])
    assert [event.id for part in parts_of(tmp_path / "b") for event in part.events] == ["jolt"]


def test_pictures_are_off_by_default_and_as_rare_as_configured(quiet: Drive, tmp_path: Path) -> None:
    frame = RgbdFrame(0, np.zeros((4, 4, 3), np.uint8), np.ones((4, 4), np.float32), np.eye(3))
    seen = [((*heard, replace(frame, stamp_ns=state.stamp_ns)), state, board) for heard, state, board in quiet.notes]
    logged(tmp_path / "off", [Drive({}, seen)])
    logged(tmp_path / "on", [Drive({}, seen)], BlackBoxSettings(pictures_hz=2.0))
    counts = [
        sum(isinstance(message, RgbdFrame) for message in read_log(segment_files(tmp_path / name)).messages())
        for name in ("off", "on")
    ]
    assert counts == [0, 5]  # of 45 ticks at 20 Hz


def test_a_disk_that_hangs_never_delays_the_chair(
    quiet: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, is_hanging, goes_on = threading.Event(), threading.Event(), threading.Event()
    write = os.write

    def hanging(file: int, data: bytes) -> int:
        if hangs.is_set():
            is_hanging.set()
            goes_on.wait(20.0)
        return write(file, data)

    monkeypatch.setattr(black_box_store.os, "write", hanging)
    heard, state, board = quiet.notes[0]
    monkeypatch.setattr(black_box, "QUEUE_TICKS", 10)
    stamps_ns = itertools.count(0, 50_000_000)
    with BlackBox(tmp_path, LOGGED_CHAIR) as box:
        hangs.set()
        while not is_hanging.wait(0.005):
            box.note_tick(heard, replace(state, stamp_ns=next(stamps_ns)), board)
        for _ in range(100):
            box.note_tick(heard, replace(state, stamp_ns=next(stamps_ns)), board)
        assert box.lost >= 90
        goes_on.set()
        wait_for(box, 0)
        box.note_tick(heard, replace(state, stamp_ns=next(stamps_ns)), board)
    log = read_log(segment_files(tmp_path))
    assert log.lost == box.lost
    assert len(log.ticks) == next(stamps_ns) // 50_000_000 - box.lost


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_a_full_or_broken_disk_ends_the_log_with_one_diagnostic(
    code: int, quiet: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    room = [80_000]

    def filling(file: int, data: bytes) -> int:
        if not room[0]:
            raise OSError(code, os.strerror(code))
        count = written(file, data[: room[0]])
        room[0] -= count
        return count

    written = os.write
    monkeypatch.setattr(black_box_store.os, "write", filling)
    with caplog.at_level(logging.WARNING), BlackBox(tmp_path, LOGGED_CHAIR) as box:
        for _ in range(4):
            quiet.tell(box)
        box.note_request("stop")
    assert os.strerror(code) in box.problem
    assert [record.getMessage() for record in caplog.records] == [box.problem]
    log = read_log(segment_files(tmp_path))
    assert len(log.ticks) > 5


def test_the_log_before_a_full_disk_tells_why_it_ends(
    quiet: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(black_box_store, "LEAST_FREE", 1 << 62)
    with pytest.raises(BoxError, match="No space left"), BlackBox(tmp_path, LOGGED_CHAIR):
        pass
    monkeypatch.undo()
    with BlackBox(tmp_path, LOGGED_CHAIR, SHORT) as box:
        quiet.tell(box)
        wait_for(box, 0)
        monkeypatch.setattr(black_box_store, "LEAST_FREE", 1 << 62)
        later = Drive({}, [(heard, replace(s, stamp_ns=s.stamp_ns + 3 * 10**10), b) for heard, s, b in quiet.notes])
        later.tell(box)
    log = read_log(segment_files(tmp_path))
    assert log.end is not None
    assert "No space left" in log.end.problem
    assert log.damaged == 0
    assert "No space left" in box.problem
    monkeypatch.undo()
    logged(tmp_path, [quiet])
    assert parts_of(tmp_path) == []  # no process has died


def test_a_second_program_is_refused_and_a_dead_one_is_not(quiet: Drive, tmp_path: Path) -> None:
    with BlackBox(tmp_path, LOGGED_CHAIR):
        assert is_written(tmp_path)
        with pytest.raises(BoxError, match="another program"), BlackBox(tmp_path, LOGGED_CHAIR):
            pass
    assert not is_written(tmp_path)
    logged(tmp_path, [quiet])


def test_an_impossible_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BoxError, match="choose another folder"), BlackBox(tmp_path / "file" / "box", LOGGED_CHAIR):
        pass


VICTIM = """
import pickle, sys, time
from dataclasses import replace
from pathlib import Path
from tests.runtime.boxes import LOGGED_CHAIR
from waychair.runtime.black_box.recorder import BlackBox
notes = pickle.loads(Path(sys.argv[2]).read_bytes())
with BlackBox(Path(sys.argv[1]), LOGGED_CHAIR) as box:
    began = time.monotonic()
    for k in range(10**6):
        heard, state, board = notes[k % len(notes)]
        box.note_tick(heard, replace(state, stamp_ns=k * 50_000_000), board)
        print(k, flush=True)
        time.sleep(0.05)
"""


def test_after_kill_9_less_than_a_second_is_missing_and_the_next_run_keeps_the_end_of_the_log(
    quiet: Drive, tmp_path: Path
) -> None:
    import pickle

    box, notes = tmp_path / "box", tmp_path / "notes"
    notes.write_bytes(pickle.dumps(quiet.notes))
    root = Path(__file__).resolve().parents[3]
    command = [sys.executable, "-c", VICTIM, str(box), str(notes)]
    victim = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root)
    assert victim.stdout is not None
    for line in victim.stdout:
        if int(line) == 40:
            victim.kill()
            break
    noted = max([40, *(int(line) for line in victim.stdout if line.strip())])
    victim.wait()
    log = read_log(segment_files(box))
    assert log.end is None
    assert noted - round(log.ticks[-1].stamp_ns / 50e6) <= 20
    assert parts_of(box) == []
    torn = segment_files(box)[-1]
    torn.write_bytes(torn.read_bytes()[:-7])
    logged(box, [quiet])
    part = parts_of(box)[0]
    assert [event.id for event in part.events] == ["program_ended"]
    assert len(part.log().ticks) >= noted - 20
    logged(box, [quiet])
    assert len(parts_of(box)) == 1  # once is enough


@pytest.fixture
def loose_end(quiet: Drive, tmp_path: Path) -> Path:
    """Return a box as a power cut leaves it."""
    with BlackBox(tmp_path / "whole", LOGGED_CHAIR) as box:
        quiet.tell(box)
        wait_for(box, 0)
        ends = time.monotonic() + 20.0
        while not read_log(segment_files(box.folder)).ticks and time.monotonic() < ends:
            time.sleep(0.01)
        return Path(shutil.copytree(box.folder, tmp_path / "cut"))


def test_a_second_crash_while_the_end_of_a_log_is_kept_does_not_block_the_box(quiet: Drive, loose_end: Path) -> None:
    (loose_end / "parts" / "0001-program_ended").mkdir()
    logged(loose_end, [quiet])
    assert [part.folder.name for part in parts_of(loose_end)] == ["0002-program_ended"]
    logged(loose_end, [quiet])
    assert len(parts_of(loose_end)) == 1


def test_a_full_disk_while_the_end_of_a_log_is_kept_is_reported_and_the_box_released(
    quiet: Drive, loose_end: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(BoxError, match="No space left"), BlackBox(loose_end, LOGGED_CHAIR):
        pass
    assert not is_written(loose_end)
    monkeypatch.undo()
    logged(loose_end, [quiet])
    assert [part.folder.name for part in parts_of(loose_end)] == ["0002-program_ended"]


def test_an_unreadable_ring_does_not_prevent_logging(quiet: Drive, tmp_path: Path) -> None:
    logged(tmp_path, [quiet])
    segment_files(tmp_path)[0].write_bytes(b"\x00" * 5000)
    (tmp_path / "parts" / "0009-odd").mkdir(parents=True)
    (tmp_path / "parts" / "0009-odd" / "part.json").write_text("{")
    logged(tmp_path, [quiet])
    assert len(read_log(segment_files(tmp_path)[1:]).ticks) == len(quiet.notes)
    shutil.rmtree(tmp_path / "ring")
    logged(tmp_path, [quiet])
