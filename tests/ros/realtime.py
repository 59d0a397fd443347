"""Tests of a whole stack in real time, which share their computer with nothing else."""

from __future__ import annotations

import os

import pytest

ALONE = pytest.mark.skipif(
    os.environ.get("WAYCHAIR_REALTIME") != "1", reason="keeps real time: run by itself, with WAYCHAIR_REALTIME=1"
)
"""For modules: their tests run only where nothing else does, as `make test` runs them at its end."""
