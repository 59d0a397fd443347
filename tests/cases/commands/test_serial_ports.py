"""A serial port that cannot be opened: the user's right, another program, and a missing board are three sentences."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from waychair.errors import TransportError
from waychair.firmware_bridge.transports import (
    SerialTransport,
    check_port,
    is_pseudo_terminal,
    open_pseudo_terminal,
    transport_from_text,
    unopened_port,
)

_NOBODY = 65534
_IMPORT = "import os, serial, sys; from waychair.firmware_bridge.transports import SerialTransport"
_OPEN = "port = SerialTransport(sys.argv[1])"


@pytest.fixture
def port() -> Iterator[str]:
    """A terminal as a board's port."""
    board, computer, path = open_pseudo_terminal()
    yield path
    os.close(board)
    os.close(computer)


def test_a_port_that_the_user_may_not_open_is_there_and_the_group_is_named(port: str) -> None:
    os.chmod(port, 0o600)  # noqa: PTH101 - a device, not a file of ours
    if os.geteuid() == 0:
        script = f"{_IMPORT}; os.setgroups([]); os.setuid({_NOBODY}); {_OPEN}"
        told = subprocess.run([sys.executable, "-c", script, port], capture_output=True, text=True, check=False).stderr
    else:
        told = unopened_port(port, errno.EACCES, "Permission denied")
    assert f"the serial port {port} is there, but this user may not open it" in told
    assert "sudo usermod -aG dialout $USER" in told
    assert "log out and in again" in told


def test_a_port_of_another_group_names_that_group(tmp_path: Path) -> None:
    like_a_port = tmp_path / "ttyACM0"
    like_a_port.touch(mode=0o660)
    like_a_port.chmod(0o660)
    group = like_a_port.group()
    told = unopened_port(str(like_a_port), errno.EACCES, "Permission denied")
    assert f"usermod -aG {'dialout' if like_a_port.stat().st_gid == 0 else group} " in told


def test_a_port_in_use_names_the_program_that_has_it(port: str) -> None:
    held = subprocess.Popen(
        [sys.executable, "-c", f"{_IMPORT}; {_OPEN}; print('open', flush=True); sys.stdin.read()", port],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert held.stdout is not None
    assert held.stdout.readline() == "open\n"
    with pytest.raises(TransportError, match=rf"is in use by '.*' \(process {held.pid}\): end that program first"):
        SerialTransport(port)
    held.communicate()
    SerialTransport(port).close()


def test_a_port_in_use_by_this_very_program_is_in_use_too(port: str) -> None:
    first = SerialTransport(port)
    with pytest.raises(TransportError, match="is in use by another program"):
        SerialTransport(port)
    first.close()


def test_a_board_that_is_not_plugged_in_is_told_so() -> None:
    with pytest.raises(TransportError, match=r"there is no serial port /dev/ttyUSB99.*: plug the board in"):
        transport_from_text("/dev/ttyUSB99")


@pytest.mark.parametrize("name", ["folder", "file.txt"])
def test_a_folder_or_a_file_is_no_port(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.txt").write_text("text")
    with pytest.raises(TransportError, match="is no serial port: name a port such as /dev/ttyUSB0"):
        transport_from_text(str(tmp_path / name))


def test_a_link_without_its_terminal_asks_for_the_program_that_makes_it(tmp_path: Path) -> None:
    with pytest.raises(TransportError, match=r"there is no terminal .*board: start the program that makes it"):
        transport_from_text(f"pty:{tmp_path / 'board'}")


@pytest.mark.parametrize("text", ["ttyUSB0", "", "pty:board", "tcp:host", "tcp::9", "tcp:host:99999", "tcp:host:0"])
def test_a_text_that_is_no_port_is_refused_without_opening_anything(text: str) -> None:
    with pytest.raises(TransportError, match="--cable"):
        check_port(text, "--cable")


def test_only_terminals_count_as_simulated_also_behind_links(port: str, tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to(port)
    assert is_pseudo_terminal(port)
    assert is_pseudo_terminal(str(link))
    assert not is_pseudo_terminal("/dev/ttyUSB0")
    assert not is_pseudo_terminal(str(tmp_path / "none"))
