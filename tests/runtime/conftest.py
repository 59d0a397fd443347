"""The drive round a block of the mapper's tests serves maps of several drives, too."""

from __future__ import annotations

from tests.slam.conftest import drive

__all__ = ["drive"]
