"""The cable: binary-clean in both directions, bounded, and robust against programs that vanish and return."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import OutputError
from waychair.simulation.plant.pseudo_terminal import CAPACITY, PseudoTerminal

ALL_BYTES = bytes(range(256))


@pytest.fixture
def cable() -> Iterator[PseudoTerminal]:
    with PseudoTerminal() as made:
        yield made


def opened(cable: PseudoTerminal) -> int:
    return os.open(cable.path, os.O_RDWR | os.O_NOCTTY)


def read_exactly(port: int, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += os.read(port, count - len(data))
    return data


def received(cable: PseudoTerminal, count: int) -> bytes:
    data = b""
    while len(data) < count and cable.wait(2.0):
        data += cable.read()
    return data


def test_all_byte_values_pass_unchanged_in_both_directions(cable: PseudoTerminal) -> None:
    port = opened(cable)
    try:
        assert cable.write(ALL_BYTES) == 256
        assert read_exactly(port, 256) == ALL_BYTES
        os.write(port, ALL_BYTES)
        assert received(cable, 256) == ALL_BYTES
        assert cable.read() == b""  # nothing is echoed
    finally:
        os.close(port)


def test_a_megabyte_passes_in_both_directions_at_once(cable: PseudoTerminal) -> None:
    down, up = (np.random.default_rng(k).bytes(1 << 20) for k in (1, 2))
    port = opened(cable)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(read_exactly(port, len(down))), daemon=True)
    writer = threading.Thread(target=lambda: _write_all(port, up), daemon=True)
    for thread in (reader, writer):
        thread.start()
    sent, came, deadline = 0, b"", time.monotonic() + 10.0
    while (sent < len(down) or len(came) < len(up)) and time.monotonic() < deadline:
        sent += cable.write(down[sent : sent + 3000])
        came += cable.read()
    while reader.is_alive() and time.monotonic() < deadline:
        cable.wait(0.01)
    os.close(port)
    assert came == up
    assert read == [down]


def _write_all(port: int, data: bytes) -> None:
    sent = 0
    while sent < len(data):
        sent += os.write(port, data[sent : sent + 4096])


def test_a_slow_reader_is_refused_more_bytes_and_loses_no_accepted_ones(cable: PseudoTerminal) -> None:
    port = opened(cable)
    data = np.random.default_rng(3).bytes(1 << 18)
    taken = 0
    while count := cable.write(data[taken : taken + 5000]):
        taken += count
    assert CAPACITY <= taken < 1 << 18
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(read_exactly(port, taken)), daemon=True)
    reader.start()
    deadline = time.monotonic() + 5.0
    while reader.is_alive() and time.monotonic() < deadline:
        cable.wait(0.01)
    os.close(port)
    assert read == [data[:taken]]
    assert cable.write(b"again") == 5


def test_a_vanished_peer_is_noticed_and_its_bytes_can_still_be_read(cable: PseudoTerminal) -> None:
    assert not cable.connected
    port = opened(cable)
    assert cable.connected
    os.write(port, b"last words")
    os.close(port)
    assert not cable.connected
    assert received(cable, 10) == b"last words"
    assert cable.read() == b""
    assert cable.write(b"to nobody") == 9


def test_a_returning_peer_finds_a_raw_line_without_the_bytes_sent_in_between(cable: PseudoTerminal) -> None:
    port = opened(cable)
    cable.write(b"unread")
    os.close(port)
    for _ in range(3):
        cable.write(b"to nobody")
        port = opened(cable)
        assert cable.connected
        assert cable.write(ALL_BYTES) == 256
        assert read_exactly(port, 256) == ALL_BYTES
        os.write(port, b"\r\n\x03\x04")
        assert received(cable, 4) == b"\r\n\x03\x04"
        os.close(port)


def test_wait_ends_after_its_time_with_and_without_a_peer(cable: PseudoTerminal) -> None:
    for connected in (False, True):
        port = opened(cable) if connected else None
        began = time.monotonic()
        assert not cable.wait(0.05)
        assert 0.05 <= time.monotonic() - began < 0.5
        if port is not None:
            os.close(port)


def test_wait_notices_a_late_peer(cable: PseudoTerminal) -> None:
    def late() -> None:
        time.sleep(0.03)
        port = opened(cable)
        os.write(port, b"here")
        os.close(port)

    threading.Thread(target=late, daemon=True).start()
    assert cable.wait(2.0)
    assert cable.read() == b"here"


def test_a_link_names_the_far_end_and_is_removed_with_it(tmp_path: Path) -> None:
    link = tmp_path / "run" / "chair"
    for _ in range(2):
        with PseudoTerminal(link) as cable:
            assert cable.path == link
            port = opened(cable)
            cable.write(b"x")
            assert os.read(port, 1) == b"x"
            os.close(port)
        assert not link.is_symlink()
        cable.close()  # a second call has no effect


def test_a_link_to_a_vanished_device_is_replaced_and_any_other_file_is_kept(tmp_path: Path) -> None:
    (tmp_path / "stale").symlink_to("/dev/pts/gone")
    with PseudoTerminal(tmp_path / "stale") as cable:
        assert cable.path.exists()
    (tmp_path / "mine").write_text("precious")
    with pytest.raises(OutputError, match="mine exists already; remove it"):
        PseudoTerminal(tmp_path / "mine")
    assert (tmp_path / "mine").read_text() == "precious"
    with pytest.raises(OutputError, match="cannot make the link"):
        PseudoTerminal(tmp_path / "mine" / "chair")


def test_a_link_taken_over_by_another_run_is_kept(tmp_path: Path) -> None:
    link = tmp_path / "chair"
    first = PseudoTerminal(link)
    link.unlink()
    with PseudoTerminal(link):
        first.close()
        assert link.is_symlink()
