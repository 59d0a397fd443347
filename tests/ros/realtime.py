"""Tests of a complete stack in real time, which need a computer without other load."""

from __future__ import annotations

import pytest

ALONE = pytest.mark.realtime
"""Marks for modules and tests that keep real time and run one after the other."""
