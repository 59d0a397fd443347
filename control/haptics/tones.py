"""Advice as tones: a few notes, in the ear of the side that they are about.

Rising: forward; falling: back; four notes in one ear: turn; two: nudge; three short high ones: warning.
"""

from __future__ import annotations

import io
import math
import wave
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from waychair.control.haptics.symbols import Advice, Symbol
from waychair.types import FloatArray

RATE_HZ = 22_050

LEVEL = 0.25
"""Greatest amplitude at full volume, of 1: -12 dBFS, so that players have room."""

_LOW, _MIDDLE, _HIGH, _TOP = 392.0, 523.25, 659.25, 987.77
"""Pitches [Hz]: G4, C5, E5, B5; within the range that old ears hear well."""

_EDGE_S = 0.008
"""Rise and fall of a note, so that it does not click."""

_NOTES: Mapping[Symbol, tuple[tuple[float, float], ...]] = MappingProxyType(
    {
        Symbol.FORWARD: ((_LOW, 0.12), (_MIDDLE, 0.12), (_HIGH, 0.12)),
        Symbol.BACK: ((_HIGH, 0.12), (_MIDDLE, 0.12), (_LOW, 0.12)),
        Symbol.SWIVEL_LEFT: ((_MIDDLE, 0.09),) * 4,
        Symbol.SWIVEL_RIGHT: ((_MIDDLE, 0.09),) * 4,
        Symbol.NUDGE_LEFT: ((_HIGH, 0.1),) * 2,
        Symbol.NUDGE_RIGHT: ((_HIGH, 0.1),) * 2,
        Symbol.WARNING: ((_TOP, 0.06),) * 3,
        Symbol.ARRIVED: ((_MIDDLE, 0.15), (_HIGH, 0.35)),
        Symbol.OBSTACLE_AT: ((_LOW, 0.15),),
        Symbol.ATTENTION: ((_HIGH, 0.15), (_MIDDLE, 0.15)),
    }
)
"""Notes of each symbol: pitch [Hz] and length [s]."""

_SIDES: Mapping[Symbol, float] = MappingProxyType(
    {Symbol.SWIVEL_LEFT: 1.0, Symbol.NUDGE_LEFT: 1.0, Symbol.SWIVEL_RIGHT: -1.0, Symbol.NUDGE_RIGHT: -1.0}
)
"""The ear of a symbol: 1 left, -1 right, 0 both."""


def tone(advice: Advice, volume: float) -> FloatArray:
    """Return the samples (n, 2) of a piece of advice, left and right, at 22050 Hz, within [-1, 1]; `volume` in [0, 1]."""
    mono = np.concatenate([_note(pitch, length) for pitch, length in _NOTES[advice.symbol]])
    side = _SIDES.get(advice.symbol, 0.0)
    if advice.symbol is Symbol.OBSTACLE_AT:
        side = math.sin(advice.direction or 0.0)
    ears = np.array([min(1.0, 1.0 + side), min(1.0, 1.0 - side)])
    samples: FloatArray = LEVEL * volume * mono[:, None] * ears
    return samples


def _note(pitch: float, length: float) -> FloatArray:
    time = np.arange(round(length * RATE_HZ)) / RATE_HZ
    edge = np.minimum(1.0, np.minimum(time, length - time) / _EDGE_S)
    note: FloatArray = np.sin(math.tau * pitch * time) * edge
    return note


def wave_file(samples: FloatArray) -> bytes:
    """Return samples (n, 2) in [-1, 1] as a WAV file of 16 bits."""
    data = io.BytesIO()
    with wave.open(data, "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes(np.round(np.clip(samples, -1.0, 1.0) * 32_767).astype("<i2").tobytes())
    return data.getvalue()
