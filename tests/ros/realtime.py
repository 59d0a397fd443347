"""Tests of a whole stack in real time, which share their computer with nothing else."""

from __future__ import annotations

import pytest

ALONE = pytest.mark.realtime
"""For modules and tests that run only where nothing else does, as `make test` runs them at its end."""
