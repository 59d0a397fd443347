"""Fixtures: the firmware as a shared library under a fake clock, and as the program `waychair_board`."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware_bridge.bridged import Bridged
from tests.firmware_bridge.rig import Rig, build_core, load_core
from waychair.firmware_bridge.board import build_board


@pytest.fixture(scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The portable firmware, built to trap on undefined behaviour."""
    return load_core(build_core(tmp_path_factory.mktemp("core")))


@pytest.fixture
def rig(core: ctypes.CDLL) -> Rig:
    """A board that was just switched on."""
    return Rig(core)


@pytest.fixture(scope="session")
def board_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware as a program on this computer."""
    return build_board(tmp_path_factory.mktemp("board"))


@pytest.fixture
def link(board_program: Path) -> Iterator[Bridged]:
    """A bridge on a board of the shipped firmware."""
    with Bridged(board_program) as bridged:
        yield bridged
