"""`waychair map-all` as a user types it, with the real mapping of a room that a chair turns round in."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair

MAP_FILES = ("map.pgm", "map.yaml", "trajectory.tum", "graph.g2o", "config.yaml", "session.npz")


def room_log(path: Path, scans: int = 12) -> Path:
    """Write a CARMEN log of a chair that drives 0.1 m a scan along the middle of a room of 8 by 6 m."""
    lines = []
    for scan in range(scans):
        x, ranges = 0.1 * scan, []
        for degree in range(-90, 91):
            across, along = math.sin(math.radians(degree)), math.cos(math.radians(degree))
            ranges.append(min((4.0 - x) / max(along, 1e-9), 3.0 / max(abs(across), 1e-9)))
        words = " ".join(f"{each:.3f}" for each in ranges)
        pose = f"{x:.3f} 0.0 0.0"
        lines.append(f"FLASER 181 {words} {pose} {pose} {scan * 0.2:.3f} host {scan * 0.2:.3f}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_maps_are_those_of_one_by_one_and_bad_recordings_are_named(tmp_path: Path) -> None:
    log = room_log(tmp_path / "room.log")
    (tmp_path / "empty.bag").touch()
    (tmp_path / "list.txt").write_text("# all of Monday\nroom.log\nempty.bag\ngone.mcap\n")
    alone = waychair("map", log, "--out", tmp_path / "alone", "--quiet", "--odom", "none")
    assert alone.returncode == 0, alone.stderr
    done = waychair("map-all", tmp_path / "list.txt", "--out", tmp_path / "out", "--odom", "none")
    sentence = refused(done)
    assert "2 of 3 recordings could not be mapped: empty: " in sentence
    assert "1 more in" in sentence
    for name in MAP_FILES:
        assert (tmp_path / "out" / "room" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name
    ended = sorted(line.partition("] ")[2] for line in done.stdout.splitlines() if line.startswith("["))
    assert ended[0].startswith(f"empty: failed: {tmp_path / 'empty.bag'} is empty")
    assert ended[1].startswith(f"gone: failed: there is no recording at {tmp_path / 'gone.mcap'}")
    assert ended[2].startswith("room: done, ")
    again = waychair("map-all", log, "--out", tmp_path / "out", "--odom", "none")
    assert (again.returncode, "room: done, kept from before" in again.stdout) == (0, True)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    (row,) = report["recordings"]
    assert (row["state"], row["kept"], report["failed"]) == ("done", True, 0)
    assert 'alt="" src="data:image/png;base64,' in (tmp_path / "out" / "index.html").read_text()


def test_a_recording_that_needs_more_memory_than_allowed_fails_with_the_option_that_helps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.cli.mapping.map_all_command._LEAST_MEMORY", 0)
    log = room_log(tmp_path / "room.log")
    done = waychair("map-all", log, "--out", tmp_path / "out", "--per-bag-memory", "20M")
    assert "it needs more memory than 0.0 GB: give more with --per-bag-memory" in refused(done)
    assert not (tmp_path / "out" / "room").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("x.log", "--per-bag-memory", "lots"), "is no amount of memory: give a number of bytes such as 4G"),
        (("x.log", "--per-bag-memory", "10M"), "give at least 200M"),
        (("x.log", "--shared", "/a=/b"), "give --cluster too"),
        (("x.log", "--cluster", "tcp://h:1", "--jobs", "2"), "omit it, the cluster's workers have their own number"),
        (("x.log", "--cluster", "tcp://h:1", "--shared", "a=b"), "must be a path here and a path on the workers"),
    ],
)
def test_impossible_options_are_refused_before_anything_is_written(
    tmp_path: Path, options: tuple[str, ...], told: str
) -> None:
    assert told in refused(waychair("map-all", *options, "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()
