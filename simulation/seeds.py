"""Seeds of surfaces: the same in every run and on every machine, unlike `hash`."""

from __future__ import annotations

import zlib


def seed_of(*names: str | int) -> int:
    """A seed in [0, 2^31) made of the names of what it is for."""
    return zlib.crc32("/".join(map(str, names)).encode()) & 0x7FFFFFFF
