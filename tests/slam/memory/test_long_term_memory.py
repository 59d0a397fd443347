"""The file of the long-term memory: committed data stay, damaged files are set aside, and the chair drives on."""

from __future__ import annotations

import contextlib
import multiprocessing
import resource
import signal
import sqlite3
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.slam.corridor import SURE, corridor, loop, set_limits, stand, view
from waychair.errors import LongTermDamaged, LongTermError
from waychair.slam.memory.long_term_file import Batch, NodeState
from waychair.slam.memory.long_term_memory import LongTermStore
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import MemoryNode, NodeStatus, pack, pack_features, seal, unpack, unseal
from waychair.types import Pose2

BOUNDED = MemorySettings(working_memory_limit=5)


@pytest.fixture(autouse=True, scope="module")
def _small_memory() -> Iterator[None]:
    """Make most nodes of a short drive sleep, so that they are read from the disk."""
    with pytest.MonkeyPatch.context() as patch:
        set_limits(patch, STM_SIZE=5, CACHED_NODES=0)
        yield


def drive(path: Path, length: int = 30) -> NodeMemory:
    """Yield an open memory of a corridor in a file, with most nodes asleep."""
    memory = corridor(0, BOUNDED, NodeMemory(BOUNDED, LongTermStore(path)))
    stand(memory, length)
    for k in range(1, length + 1):
        memory.add(view(k), SURE)
        memory.transfer()
    return memory


def same(a: MemoryNode, b: MemoryNode) -> bool:
    assert a.evidence is not None
    assert b.evidence is not None
    arrays = ("words", "pixels", "points", "descriptors", "surface")
    equal = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in arrays)
    poses = (a.evidence.node_from_first, a.evidence.node_from_last) == (
        b.evidence.node_from_first,
        b.evidence.node_from_last,
    )
    ranges = np.array_equal(a.evidence.scan.ranges, b.evidence.scan.ranges)
    return equal and poses and ranges and (a.stamp_ns, a.odom_from_base) == (b.stamp_ns, b.odom_from_base)


@given(
    st.lists(
        hnp.arrays(
            st.sampled_from([np.float32, np.float64, np.uint8, np.int32, np.int64]),
            hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=5),
        ),
        max_size=4,
    )
)
def test_packed_arrays_are_unpacked_unchanged(arrays: list[np.ndarray]) -> None:  # type: ignore[type-arg]
    found = unpack(pack(arrays))
    assert len(found) == len(arrays)
    for a, b in zip(arrays, found, strict=True):
        assert a.dtype == b.dtype
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


@given(st.binary(max_size=60))
def test_bytes_other_than_packed_arrays_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="no packed arrays"):
        unpack(data)


@given(st.binary(max_size=50), st.integers(0, 2**40), st.data())
def test_a_checksum_detects_any_changed_bit_and_any_other_node_number(
    body: bytes, number: int, data: st.DataObject
) -> None:
    sealed = seal(number, body)
    assert unseal(number, sealed) == body
    bit = data.draw(st.integers(0, 8 * len(sealed) - 1))
    broken = bytearray(sealed)
    broken[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ValueError, match="checksum"):
        unseal(number, bytes(broken))
    if body:
        with pytest.raises(ValueError, match="checksum"):
            unseal(number + 1, sealed)


def test_nodes_are_read_back_from_the_file_unchanged(tmp_path: Path) -> None:
    drive(tmp_path / "memory.db").close()
    store = LongTermStore(tmp_path / "memory.db")
    assert all(same(store.node(k), view(k)) for k in range(1, 31))
    store.close()


def test_a_node_not_yet_written_to_the_disk_can_be_read(tmp_path: Path) -> None:
    store = LongTermStore(tmp_path / "memory.db")
    node = MemoryNode(5, Pose2(), np.arange(10, dtype=np.int32), id=7)
    store.write(Batch(nodes=(node,)))
    assert store.node(7).words.tolist() == list(range(10))
    store.close()


def test_a_reopened_memory_continues_from_its_end(tmp_path: Path) -> None:
    memory = drive(tmp_path / "memory.db", 30)
    memory.link(loop(3, 30))
    memory.add(view(31, view(30).words.tolist(), x=31.0), SURE)
    awake, asleep, weight = set(memory.stm) | memory.wm, set(memory.skeleton.ids(NodeStatus.LTM)), memory.weight(30)
    links = {(link.i, link.j): link for link in memory.skeleton.every_link()}
    memory.close()

    again = NodeMemory(BOUNDED, LongTermStore(tmp_path / "memory.db"))
    assert again.wm == awake
    assert again.stm == ()
    assert {node.id for node in again.awake} == awake
    assert set(again.skeleton.ids(NodeStatus.LTM)) == asleep
    assert again.weight(30) == weight == 1
    assert again.map_id == 1
    assert again.last_closure == 30
    assert np.array_equal(again.anchors, memory.anchors)
    found = {(link.i, link.j): link for link in again.skeleton.every_link()}
    assert found.keys() == links.keys()
    assert all(np.array_equal(found[ends].information, links[ends].information) for ends in links)
    assert again.add(view(40), SURE).id == 32
    again.close()


def test_merged_nodes_leave_no_record_and_those_of_an_older_file_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    memory = NodeMemory(store=LongTermStore(path))
    memory.add(view(1), SURE)
    for second in range(5):
        memory.add(view(2, x=2.0, second=2 + second), SURE)
    memory.close()
    store = LongTermStore(path)
    assert len(store.load().nodes) == 2
    store.write(Batch(nodes=(replace(view(3), id=3),), states=(NodeState(3, 0, False, 3, Pose2(), parent=2),)))
    store.close()
    again = NodeMemory(store=LongTermStore(path))
    assert again.skeleton.ids() == [1, 2]
    assert again.weight(2) == 4
    again.close()


def test_a_dropped_node_and_a_refused_loop_are_not_in_the_file(tmp_path: Path) -> None:
    memory = drive(tmp_path / "memory.db", 10)
    memory.link(loop(1, 9))
    memory.flush()
    memory.unlink(1, 9)
    memory.drop(10)
    memory.close()
    again = NodeMemory(store=LongTermStore(tmp_path / "memory.db"))
    assert again.skeleton.ids() == list(range(1, 10))
    assert again.skeleton.linked(1, 9) is None
    again.close()


def test_unused_words_are_kept_in_the_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    descriptors = rng.integers(0, 256, (5, 32), dtype=np.uint8)
    memory = NodeMemory(store=LongTermStore(tmp_path / "memory.db"))
    memory.add(view(1), SURE, new_words=(np.arange(11, 16), descriptors))
    found, rows = memory.store.words(np.array([13, 99, 11]))
    assert found.tolist() == [13, 11]
    assert np.array_equal(rows, descriptors[[2, 0]])
    memory.close()


def test_a_killed_process_loses_at_most_the_last_node(tmp_path: Path) -> None:
    """A small sample of `evaluation.figures.mapping.memory.killed`."""
    rng, path = np.random.default_rng(3), tmp_path / "memory.db"
    seen: set[int] = set()
    for _ in range(5):
        added = killed_after(path, float(rng.uniform(0.05, 0.15)))
        again = NodeMemory(BOUNDED, LongTermStore(path))
        there = set(again.skeleton.ids())
        assert seen <= there
        assert (seen | set(added)) - there <= set(added[-1:])
        assert all(same(again.node(k), view(k)) for k in there)
        again.close()
        seen = there
    assert len(seen) > 10


def killed_after(path: Path, seconds: float) -> list[int]:
    """Return the numbers of the nodes that a process had added when it was killed; it forks from one without threads."""
    children = multiprocessing.get_context("forkserver")
    children.set_forkserver_preload([__name__])
    heard, tell = children.Pipe(duplex=False)
    child = children.Process(target=map_for_ever, args=(path, tell))
    child.start()
    tell.close()
    added = [heard.recv()]  # at least one
    time.sleep(seconds)
    child.kill()
    with contextlib.suppress(EOFError, OSError):  # of a message that was cut off, too
        while True:
            added.append(heard.recv())
    child.join()
    return added


def map_for_ever(path: Path, tell: Connection) -> None:
    memory = NodeMemory(BOUNDED, LongTermStore(path))
    while True:
        number = memory.skeleton.count
        memory.add(view(number), SURE)
        tell.send(number)
        memory.transfer()


@pytest.mark.parametrize("what", [b"this is no database at all, but some text of some length", b"\x00" * 5000])
def test_a_file_that_is_not_a_database_is_set_aside_and_the_chair_drives_on(tmp_path: Path, what: bytes) -> None:
    path = tmp_path / "memory.db"
    path.write_bytes(what)
    memory = drive(path, 5)
    assert memory.store.fault is None
    assert "damaged" in memory.store.notes[0]
    assert str(tmp_path / "memory.db.damaged-1") in memory.store.notes[0]
    memory.close()
    assert (tmp_path / "memory.db.damaged-1").read_bytes() == what
    path.write_bytes(what)
    LongTermStore(path).close()
    assert (tmp_path / "memory.db.damaged-2").read_bytes() == what


@pytest.fixture(scope="session")
def sound_file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of a memory of twelve nodes, mostly asleep."""
    path = tmp_path_factory.mktemp("sound") / "memory.db"
    drive(path, 12).close()
    return path.read_bytes()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(data=st.data())
def test_damaged_files_are_set_aside_and_damaged_records_left_out_or_named(
    sound_file: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    """Bytes are overwritten or the end cut off: readable records are unchanged, and the drive goes on."""
    path = tmp_path / "memory.db"
    for old in tmp_path.glob("memory.db*"):
        old.unlink()
    content = bytearray(sound_file)
    for _ in range(data.draw(st.integers(0, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        some = data.draw(st.binary(min_size=1, max_size=64))
        content[at : at + len(some)] = some
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    path.write_bytes(bytes(content))
    memory = NodeMemory.opened(path, BOUNDED)
    for node in memory.skeleton.ids(NodeStatus.WM, NodeStatus.LTM):
        with contextlib.suppress(LongTermDamaged):
            assert same(memory.node(node), view(node))
    for _ in memory.evidence(memory.skeleton.ids()):
        pass
    stand(memory, 20)
    first = memory.add(view(13), SURE).id
    memory.retrieve(min(memory.wm, default=None), Pose2(3.0))
    memory.transfer()
    assert same(memory.node(first), view(13))
    memory.close()


def test_a_damaged_view_is_left_out_and_its_place_stays_in_the_graph(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    memory = drive(path, 30)
    memory.flush()
    with sqlite3.connect(path) as other:
        other.execute("UPDATE nodes SET features = zeroblob(40) WHERE id = 2")
    other.close()
    memory.add(view(31), SURE)
    woken = memory.retrieve(3, Pose2(-50.0)).woken if 3 in memory.wm else memory.retrieve(None, Pose2(2.0)).woken
    assert 2 not in {node.id for node in woken}
    for _ in range(3):
        memory.add(view(memory.skeleton.count), SURE)
        memory.retrieve(None, Pose2(2.0))
    assert memory.skeleton.kept(2) is NodeStatus.LOST
    assert memory.counts().unreadable == 1
    assert memory.skeleton.neighbours(2) == [3, 1]
    with pytest.raises(LongTermDamaged, match="node 2"):
        memory.node(2)
    memory.close()


def test_a_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "rtabmap.db"
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE Node (id INTEGER PRIMARY KEY)")
    other.close()
    before = path.read_bytes()
    with pytest.raises(LongTermError, match="another program"):
        LongTermStore(path)
    assert path.read_bytes() == before


def test_a_file_of_a_newer_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    drive(path, 3).close()
    with sqlite3.connect(path) as other:
        other.execute("PRAGMA user_version = 99")
    other.close()
    with pytest.raises(LongTermError, match="schema 99"):
        LongTermStore(path)


def test_a_read_only_folder_is_named_and_the_memory_stays_in_ram(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    path = tmp_path / "file" / "memory.db"
    with pytest.raises(LongTermError, match="choose another folder"):
        LongTermStore(path)
    memory = NodeMemory.opened(path, BOUNDED)
    assert "choose another folder" in str(memory.store.fault)
    stand(memory, 30)
    for k in range(1, 31):
        memory.add(view(k), SURE)
        memory.transfer()
    assert memory.counts().ltm > 10
    assert all(same(memory.node(k), view(k)) for k in range(1, 31))
    memory.close()


def full(memory: NodeMemory, begin: int) -> None:
    for k in range(begin, begin + 60):
        memory.add(view(k), SURE)
        memory.transfer()


def test_a_full_disk_is_named_nothing_is_lost_in_ram_and_nothing_is_broken_on_disk(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    memory = NodeMemory(BOUNDED, LongTermStore(path, most_bytes=80_000))
    stand(memory, 100)
    full(memory, 1)
    memory.flush()
    assert "full" in str(memory.store.fault)
    assert "make room" in str(memory.store.fault)
    assert memory.counts().ltm > 30
    assert all(same(memory.node(k), view(k)) for k in range(1, 61))
    assert sum(len(chunk) for chunk in memory.evidence(range(1, 61))) == 60
    memory.close()
    again = NodeMemory(BOUNDED, LongTermStore(path))
    there = again.skeleton.ids()
    assert there == list(range(1, len(there) + 1))
    assert 5 < len(there) < 60
    assert all(same(again.node(k), view(k)) for k in there)
    again.close()


def test_a_write_truncated_by_the_system_damages_nothing(tmp_path: Path) -> None:
    """No file of this process may grow beyond 100 kB, so that a write ends in its middle."""
    path = tmp_path / "memory.db"
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    memory = NodeMemory(BOUNDED, LongTermStore(path))
    stand(memory, 100)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
        full(memory, 1)
        memory.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert memory.store.fault is not None
    assert all(same(memory.node(k), view(k)) for k in range(1, 61))
    memory.close()
    again = NodeMemory(BOUNDED, LongTermStore(path))
    assert again.store.notes == ()
    assert all(same(again.node(k), view(k)) for k in again.skeleton.ids())
    again.close()


def test_a_disk_that_hangs_does_not_stop_the_chair_and_nothing_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    memory = NodeMemory(BOUNDED, LongTermStore(path, patience_s=0.01))
    memory.add(view(1), SURE)
    memory.flush()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")  # no other connection can write now
    for k in range(2, 21):
        memory.add(view(k), SURE)
        memory.transfer()
    assert other.execute("SELECT count(*) FROM nodes").fetchone()[0] == 1
    other.execute("ROLLBACK")
    other.close()
    memory.close()
    assert memory.store.fault is None
    store = LongTermStore(path)
    assert [node for node, _, _ in store.load().nodes] == list(range(1, 21))
    store.close()


def test_renumbered_words_survive_a_full_disk(tmp_path: Path) -> None:
    memory = NodeMemory(BOUNDED, LongTermStore(tmp_path / "memory.db", most_bytes=80_000))
    full(memory, 1)
    memory.flush()
    assert memory.store.fault is not None
    node = max(memory.wm)
    for words in ([7, 8, 9, 0, 11], [1, 2, 3, 4, 5]):
        memory.rewrite(node, np.array(words, np.int32))
        memory.flush()
        assert memory.store.node(node).words.tolist() == words
    memory.close()


def test_two_programs_do_not_write_over_each_other(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    a, b = NodeMemory(BOUNDED, LongTermStore(path)), NodeMemory(BOUNDED, LongTermStore(path))
    a.add(view(1), SURE)
    a.flush()
    b.add(view(2), SURE)
    b.flush()
    assert "UNIQUE" in str(b.store.fault)
    a.close()
    b.close()
    store = LongTermStore(path)
    assert same(store.node(1), view(1))
    store.close()


def test_a_transaction_is_stored_completely_or_not_at_all(tmp_path: Path) -> None:
    store = LongTermStore(tmp_path / "memory.db")
    good = MemoryNode(1, Pose2(), id=1)
    store.write(Batch(nodes=(good,)))
    store.write(Batch(nodes=(MemoryNode(2, Pose2(), id=2), good), states=(NodeState(2, 0, True, 0, Pose2()),)))
    store.close()
    assert store.fault is not None
    again = LongTermStore(tmp_path / "memory.db")
    assert [node for node, _, _ in again.load().nodes] == [1]
    assert again.load().states == ()
    again.close()


def test_a_view_takes_as_much_disk_space_as_its_arrays() -> None:
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 256, (500, 32), dtype=np.uint8)
    node = MemoryNode(0, Pose2(), np.arange(500, dtype=np.int32), descriptors=bits)
    assert len(pack_features(node)) < 500 * (32 + 4)
