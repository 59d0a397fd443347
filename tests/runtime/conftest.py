"""The drive round a block that the mapper's tests use serves maps of several drives as well."""

from __future__ import annotations

from tests.slam.conftest import drive

__all__ = ["drive"]
