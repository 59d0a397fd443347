"""Shared memory of killed processes is removed; living processes keep theirs."""

from __future__ import annotations

import fcntl
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.ros.shared_memory import FOLDER, remove_dead_segments

if TYPE_CHECKING:
    from tests.ros.harness import Harness

NODE = Path(__file__).with_name("plain_node.py")
SEGMENT, PORT = "fastrtps_0123456789abcdef", "fastrtps_port7411"


def locks_of(pid: int) -> set[Path]:
    """Return the segments that a process holds (proc(5)), without any that it closes meanwhile."""
    held = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):
            held.add(link.readlink())
    return {path for path in held if path.parent == FOLDER and path.name.endswith("_el") and "port" not in path.name}


def test_segments_of_killed_processes_are_removed_and_those_of_living_ones_stay(ros: Harness) -> None:
    with ros.process(NODE) as living, ros.process(NODE) as killed:
        ros.spin_until(lambda: locks_of(living.pid) and locks_of(killed.pid), "their segments")
        kept, left = locks_of(living.pid), locks_of(killed.pid)
        killed.kill()
        killed.wait()
        assert all(lock.exists() for lock in left), "no other program removes them"
        assert remove_dead_segments() >= len(left)
        gone = [*left, *(lock.with_name(lock.name.removesuffix("_el")) for lock in left)]
        assert not any(path.exists() for path in gone)
        assert all(lock.exists() for lock in kept)


def test_ports_are_removed_only_if_no_process_lives(tmp_path: Path) -> None:
    half_made, others = "fastrtps_port7413", "sem.mp-others"
    for name in (SEGMENT, f"{SEGMENT}_el", PORT, f"{PORT}_el", f"sem.{PORT}_mutex", half_made, others):
        (tmp_path / name).touch()
    before = set(tmp_path.iterdir())
    with (tmp_path / f"{SEGMENT}_el").open() as lock, (tmp_path / f"{PORT}_el").open() as listens:
        fcntl.flock(lock, fcntl.LOCK_EX)
        fcntl.flock(listens, fcntl.LOCK_EX)
        assert remove_dead_segments(tmp_path) == 0
        assert set(tmp_path.iterdir()) == before
    assert remove_dead_segments(tmp_path) == 1
    assert set(tmp_path.iterdir()) == {tmp_path / others}


def test_without_shared_memory_there_is_nothing_to_remove(tmp_path: Path) -> None:
    assert remove_dead_segments(tmp_path / "none") == 0
