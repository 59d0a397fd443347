"""Shared by all tests: where the real recordings are, and that an interrupt is heard."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# The first call of a kernel loads or compiles it, which is no slow test. The same examples every time, so that a run
# says the same twice; `pytest --hypothesis-profile=search` draws new ones.
settings.register_profile("waychair", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None)
settings.load_profile("waychair")

# A shell starts what it puts in the background deaf to interrupts, and so would be all that tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real recordings (`WAYCHAIR_DATA`, default ../shared/data): skips without it, unless required."""
    folder = Path(os.environ.get("WAYCHAIR_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        message = f"no recordings at {folder}: set WAYCHAIR_DATA to the folder that holds lidar_intel"
        if os.environ.get("WAYCHAIR_REQUIRE_DATA") == "1":
            pytest.fail(message)
        pytest.skip(message)
    return folder
