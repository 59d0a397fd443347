"""Seeds made of names and random streams: the same in every run and on every machine, unlike `hash`."""

from __future__ import annotations

import zlib

import numpy as np


def seed_from_names(*names: str | int) -> int:
    """Return a seed in [0, 2^31) made of the names of its item."""
    return zlib.crc32("/".join(map(str, names)).encode()) & 0x7FFFFFFF


def chair_seed(seed: int, number: int) -> int:
    """Return the seed of one of several chairs in a level; that of the first is the level's own."""
    return seed if number == 0 else seed_from_names("chair", seed, number)


def random_stream(seed: int, part: int) -> np.random.Generator:
    """Return the random stream of a simulated chair's part, so that a change of one does not change the others' bytes."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(part,)))
