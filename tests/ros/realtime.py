"""Tests of a complete stack in real time; other programs must give way to them."""

from __future__ import annotations

import pytest

ALONE = pytest.mark.realtime
"""Marks for modules and tests that keep real time and run one after the other."""
