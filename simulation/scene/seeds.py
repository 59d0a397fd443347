"""Seeds made of names: the same in every run and on every machine, unlike `hash`."""

from __future__ import annotations

import zlib


def seed_from_names(*names: str | int) -> int:
    """Return a seed in [0, 2^31) made of the names of its item."""
    return zlib.crc32("/".join(map(str, names)).encode()) & 0x7FFFFFFF
