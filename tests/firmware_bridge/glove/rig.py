"""The glove's loop under a fake clock: the shipped C as a shared library, on hardware of numbers (`rig.c`).

Functions named `test_*` with a `GloveRig` as their only argument, called `rig`, are collected by pytest, and by `cases.py`, which
runs them against libraries that were built in other ways: with sanitizers, with coverage, with mutations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.firmware_bridge.rig import STRICT, TRAP
from waychair.firmware_bridge.board import FIRMWARE, compile_c
from waychair.firmware_bridge.glove.messages import (
    GLOVE_PAYLOAD_MAX,
    Alive,
    GloveDecoder,
    GloveMessage,
    GloveReply,
    GloveStatus,
    Hand,
    Play,
    PlayStep,
    encode_glove,
    glove_hello,
)

SOURCES = ("glove/glove_core.c", "glove/glove_protocol.c", "glove/glove_board.c", "frame.c")
LIMIT = f"-DFRAME_PAYLOAD_LIMIT={GLOVE_PAYLOAD_MAX}"
RIG = Path(__file__).with_name("rig.c")
MOTORS = 9


def build_glove_core(folder: Path, flags: Sequence[str] = TRAP, firmware: Path = FIRMWARE) -> Path:
    """The library of the portable sources and the rig."""
    library = folder / "glove.so"
    objects = []
    for source in (*(firmware / name for name in SOURCES), RIG):
        target = folder / f"{source.stem}.o"
        common = [*STRICT, LIMIT, "-g", "-fPIC", f"-I{firmware}", *flags]
        compile_c([*common, "-c", str(source), "-o", str(target)])
        objects.append(str(target))
    compile_c([*flags, "-shared", *objects, "-o", str(library)])
    return library


class GloveRig:
    """A glove that was just switched on, worn and in order; `start` switches it on again."""

    def __init__(self, library: Path) -> None:
        self.core = ctypes.CDLL(str(library))
        self.core.rig_take.restype = ctypes.c_size_t
        self.core.rig_kicks.restype = ctypes.c_uint32
        self.core.rig_sense.argtypes = (
            ctypes.c_bool,
            ctypes.c_uint8,
            ctypes.c_uint16,
            ctypes.c_uint16,
            ctypes.c_int8,
        )
        self.start()

    def start(self, motors: int = MOTORS, hand: Hand = Hand.RIGHT, now_ms: int = 0) -> None:
        """Switch it on, named A, with the layout 1."""
        self.now_ms = now_ms
        self.sequence = 0
        self.replies: list[GloveReply] = []
        self.reports: list[GloveStatus] = []
        self.numbers: list[int] = []
        self.decoder = GloveDecoder()
        self.core.rig_start(b"A".ljust(16, b"\0"), 1, motors, int(hand))
        self.sense()

    def sense(
        self, worn: bool = True, pressed: int = 0, opened: int = 0, shorted: int = 0, temperature_c: int = 25
    ) -> None:
        """Set sensors and buttons from now on."""
        self.core.rig_sense(worn, pressed, opened, shorted, temperature_c)

    def feed(self, data: bytes) -> None:
        """Bytes arrive."""
        self.core.rig_feed(data, ctypes.c_size_t(len(data)))

    def send(self, *messages: GloveMessage) -> int:
        """Frames arrive; their numbers follow each other. The last one's number is returned."""
        for message in messages:
            self.sequence = (self.sequence + 1) & 0xFFFF
            self.feed(encode_glove(message, self.sequence))
        return self.sequence

    def run(self, ms: int) -> NDArray[np.uint8]:
        """Levels of the next milliseconds, (ms, 16)."""
        levels = np.zeros((ms, 16), np.uint8)
        self.core.rig_run(
            ctypes.c_uint32(self.now_ms & 0xFFFFFFFF), ctypes.c_uint32(ms), levels.ctypes.data_as(ctypes.c_void_p)
        )
        self.now_ms += ms
        self._listen()
        return levels

    def run_alive(self, ms: int, armed: bool = True) -> NDArray[np.uint8]:
        """The same, with a sign of life every 100 ms."""
        parts = []
        while ms > 0:
            self.send(Alive(int(armed)))
            parts.append(self.run(min(ms, 100)))
            ms -= 100
        return np.concatenate(parts)

    def jump(self, ms: int) -> None:
        """The next step is this much later than it would be."""
        self.now_ms += ms

    def greet(self) -> None:
        """Begin a session."""
        self.send(glove_hello("A", 1))
        self.run(1)

    def arm(self) -> None:
        """Begin a session in which advice is on."""
        self.greet()
        self.send(Alive(1))
        self.run(1)

    def play(self, *steps: tuple[int, int, int, int], priority: int = 100, valid_ms: int = 1000) -> int:
        """Send a pattern of (mask, strength, on, off)."""
        return self.send(Play(priority, valid_ms, tuple(PlayStep(*step) for step in steps)))

    def judged(self) -> int:
        """What the board said to the last pattern: its `PlayRefusal`."""
        self.run(1)
        assert self.report.judged == self.sequence
        return self.report.refused

    @property
    def report(self) -> GloveStatus:
        """The last one."""
        return self.reports[-1]

    def _listen(self) -> None:
        buffer = ctypes.create_string_buffer(1 << 16)
        count = self.core.rig_take(buffer)
        for received in self.decoder.feed(buffer.raw[:count]):
            self.numbers.append(received.sequence)
            if isinstance(received.message, GloveReply):
                self.replies.append(received.message)
            elif isinstance(received.message, GloveStatus):
                self.reports.append(received.message)


def spans(levels: NDArray[np.uint8], motor: int) -> list[tuple[int, int]]:
    """First millisecond and length of each vibration of a motor."""
    on = np.concatenate([[0], (levels[:, motor] > 0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(on))
    return [(int(begin), int(end - begin)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
