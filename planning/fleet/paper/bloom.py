"""Bloom filters: sets that never deny a member and now and then claim a stranger (B. Bloom, CACM 13(7), 1970)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass

FALSE_POSITIVES = 0.01
"""Share of strangers that a full filter claims; a smaller share costs memory, a larger one messages."""


@dataclass(frozen=True, slots=True)
class BloomFilter:
    """A set of names in `size` bits, each name marked at `marks` of them; `bits` is their pattern."""

    size: int
    marks: int
    bits: int = 0

    def __contains__(self, name: str) -> bool:
        mask = _mask(name, self.size, self.marks)
        return self.bits & mask == mask

    def with_names(self, names: Iterable[str]) -> BloomFilter:
        """Return the filter with more members."""
        bits = self.bits
        for name in names:
            bits |= _mask(name, self.size, self.marks)
        return BloomFilter(self.size, self.marks, bits)

    @property
    def bytes(self) -> int:
        """The memory of its pattern [bytes]."""
        return (self.size + 7) // 8


def empty_filter(members: int, false_positives: float = FALSE_POSITIVES) -> BloomFilter:
    """Return a filter for a number of members, of the least size that keeps the share of false positives.

    A filter for no members has one byte and denies every name.
    """
    if members == 0:
        return BloomFilter(8, 1)
    size = math.ceil(-members * math.log(false_positives) / math.log(2) ** 2)
    return BloomFilter(max(size, 8), max(1, round(size / members * math.log(2))))


def _mask(name: str, size: int, marks: int) -> int:
    digest = hashlib.blake2b(name.encode(), digest_size=16).digest()
    first, step = int.from_bytes(digest[:8], "big"), int.from_bytes(digest[8:], "big") | 1
    mask = 0
    for i in range(marks):
        mask |= 1 << ((first + i * step) % size)  # double hashing, after Kirsch and Mitzenmacher, 2006
    return mask
