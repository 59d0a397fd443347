"""Fixtures: the glove's loop as a library under a fake clock, and the glove as a program."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.firmware_bridge.glove.rig import GloveRig, build_glove_core
from waychair.firmware_bridge.glove.program import build_glove


@pytest.fixture(scope="session")
def glove_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The portable firmware, built to trap on undefined behaviour."""
    return build_glove_core(tmp_path_factory.mktemp("glove"))


@pytest.fixture
def rig(glove_library: Path) -> GloveRig:
    """A glove that was just switched on."""
    return GloveRig(glove_library)


@pytest.fixture(scope="session")
def glove_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware as a program on this computer."""
    return build_glove(tmp_path_factory.mktemp("glove_program"))
