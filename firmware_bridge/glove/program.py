"""The glove's shipped firmware as a process on this computer: build it, start it on a pseudo-terminal, step it.

`HostGlove` stands for the glove in a simulation: the bridge talks to its `transport`, the simulator calls `step` and gets the
levels of all motors for every millisecond, which is all that a simulated driver may feel. `LiveGlove` runs in real time.
"""

from __future__ import annotations

import os
import select
import signal
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from waychair.errors import BoardBuildError, BridgeError
from waychair.files import cache_folder
from waychair.firmware_bridge.board import C_FLAGS, FIRMWARE, LockstepTransport, build_program, exchange
from waychair.firmware_bridge.glove.layouts import MOTORS_MAX, layout_named
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import GLOVE_PAYLOAD_MAX, Hand
from waychair.firmware_bridge.transports import DescriptorTransport, open_pseudo_terminal

GLOVE_FIRMWARE = FIRMWARE / "glove"

GLOVE_C_FLAGS = (*C_FLAGS, f"-DFRAME_PAYLOAD_LIMIT={GLOVE_PAYLOAD_MAX}")

_REQUEST = struct.Struct("<IIBBbBHH")
_ANSWER = struct.Struct("<III")
_RECORD = struct.Struct(f"<I{MOTORS_MAX}s")


@dataclass(frozen=True, slots=True)
class GloveConfig:
    """What is written into a glove's firmware: its name (at most 16 bytes), its layout by name, and its hand."""

    device_id: str = "A"
    layout: str = "glove_3x3"
    hand: Hand = Hand.RIGHT


@dataclass(frozen=True, slots=True)
class GloveInputs:
    """The glove's sensors, buttons and defects: worn, `repeat` and `yes` pressed, temperature [Celsius], motors by bit.

    `frozen`: the firmware hangs; without `powered` the board is off, and boots when this ends.
    """

    worn: bool = True
    repeat: bool = False
    yes: bool = False
    temperature_c: int = 25
    open_motors: int = 0
    shorted_motors: int = 0
    frozen: bool = False
    powered: bool = True


def build_glove(folder: Path) -> Path:
    """Return the program `waychair_glove`, built into `folder` unless one of the same sources is there already.

    Raises:
        BoardBuildError: there is no C compiler, or it refuses the sources.
        OutputError: the folder cannot be written to.
    """
    host = GLOVE_FIRMWARE / "host"
    sources = [FIRMWARE / "frame.c", *GLOVE_FIRMWARE.glob("*.c"), *host.glob("*.c")]
    headers = [FIRMWARE / "frame.h", FIRMWARE / "bytes.h", *GLOVE_FIRMWARE.glob("*.h"), *host.glob("*.h")]
    return build_program("waychair_glove", folder, sources, headers, GLOVE_C_FLAGS)


def glove_program() -> Path:
    """Return the program, built into the user's cache at its first use; raises as `build_glove`."""
    return build_glove(cache_folder())


class HostGlove:
    """A running glove in lockstep with a simulation, as a context manager. Its motors rest until it is told to play."""

    def __init__(self, program: Path, config: GloveConfig | None = None) -> None:
        """
        Raises:
            BoardBuildError: the program cannot be started.
            GloveError: the layout is not known.
            TransportError: the system has no pseudo-terminal left.
        """
        self.config = config or GloveConfig()
        words = _words(self.config)
        board, computer, self.path = open_pseudo_terminal()
        self._requests, self._answers = os.pipe(), os.pipe()
        self._computer = computer
        self.transport = LockstepTransport(os.dup(computer))
        lockstep = ["--lockstep", f"{self._requests[0]},{self._answers[1]}"]
        try:
            self._process = _start(program, board, [*words, *lockstep], (self._requests[0], self._answers[1]))
        except OSError as error:
            self._release()
            raise BoardBuildError(f"cannot start {program}: {error.strerror}; build the glove again") from error
        finally:
            for descriptor in (board, self._requests[0], self._answers[1]):
                os.close(descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def alive(self) -> bool:
        """Whether the glove's program runs."""
        return self._process.poll() is None

    def step(self, now_ms: int, inputs: GloveInputs | None = None) -> MotorLevels:
        """Run the glove up to `now_ms` (modulo 2^32); return its motors' levels in every millisecond since the last step.

        The glove first waits for all bytes written to `transport`, so that the same calls give the same answers. A step of
        0, backwards, or of more than a second is a jump of the glove's clock, of one row. A glove that was killed gives one
        row of rest.

        Raises:
            BridgeError: the program runs but does not answer, or an input does not fit its range.
        """
        request = _request(now_ms, self.transport.written, inputs or GloveInputs())
        head = exchange(self._requests[1], self._answers[0], request, _ANSWER.size)
        if head is None:
            return MotorLevels(now_ms & 0xFFFFFFFF, np.zeros((1, MOTORS_MAX), np.uint8))
        sent, _, count = _ANSWER.unpack(head)
        rows = exchange(self._requests[1], self._answers[0], b"", count * MOTORS_MAX) or b""
        self.transport.expected = sent
        levels = np.frombuffer(rows, np.uint8).reshape(-1, MOTORS_MAX)
        return MotorLevels((now_ms - len(levels) + 1) & 0xFFFFFFFF, levels)

    def kill(self) -> None:
        """Remove the glove's power at once and for good."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """End the program and close its descriptors."""
        if self.alive:
            self.kill()
        self._release()

    def _release(self) -> None:
        self.transport.close()
        for descriptor in (self._computer, self._requests[1], self._answers[0]):
            os.close(descriptor)


class LiveGlove:
    """A glove that runs by itself in real time, worn and in order, as a context manager; its clock is the monotonic one."""

    def __init__(self, program: Path, config: GloveConfig | None = None) -> None:
        """Raises as `HostGlove`."""
        words = _words(config or GloveConfig())
        board, self._computer, self.path = open_pseudo_terminal()
        self._levels, reported = os.pipe()
        self.transport = DescriptorTransport(os.dup(self._computer))
        self._pending = b""
        try:
            live = ["--realtime", "--levels-fd", str(reported)]
            self._process = _start(program, board, [*words, *live], (reported,))
        except OSError as error:
            self._release()
            raise BoardBuildError(f"cannot start {program}: {error.strerror}; build the glove again") from error
        finally:
            os.close(board)
            os.close(reported)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._release()

    @property
    def pid(self) -> int:
        """The program's process."""
        return self._process.pid

    def records(self, timeout_s: float = 0.0) -> list[tuple[int, bytes]]:
        """Return the records reported since the last call: the clock [ms, modulo 2^32] and the 16 levels of each.

        Nothing is returned if none comes within the time. A glove whose records are not fetched stands still when its pipe
        is full, after three seconds.
        """
        ready, _, _ = select.select([self._levels], [], [], timeout_s)
        data = self._pending + (os.read(self._levels, 1 << 16) if ready else b"")
        whole = len(data) - len(data) % _RECORD.size
        self._pending = data[whole:]
        return [(ms, levels) for ms, levels in _RECORD.iter_unpack(data[:whole])]

    def _release(self) -> None:
        self.transport.close()
        for descriptor in (self._computer, self._levels):
            os.close(descriptor)


def _words(config: GloveConfig) -> list[str]:
    """Return the program's options for a configuration."""
    layout = layout_named(config.layout)
    options = {
        "--device": config.device_id,
        "--layout": layout.number,
        "--motors": len(layout.tactors),
        "--hand": int(config.hand),
    }
    return [str(word) for option in options.items() for word in option]


def _start(program: Path, terminal: int, words: list[str], kept: tuple[int, ...]) -> subprocess.Popen[bytes]:
    os.set_blocking(terminal, False)
    return subprocess.Popen(
        [str(program), "--serial-fd", str(terminal), *words],
        pass_fds=(terminal, *kept),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )


def _request(now_ms: int, written: int, inputs: GloveInputs) -> bytes:
    defect = 2 if not inputs.powered else int(inputs.frozen)
    try:
        return _REQUEST.pack(
            now_ms & 0xFFFFFFFF,
            written,
            inputs.worn,
            inputs.repeat | inputs.yes << 1,
            inputs.temperature_c,
            defect,
            inputs.open_motors,
            inputs.shorted_motors,
        )
    except struct.error as error:
        raise BridgeError(f"{inputs} cannot be given to the glove: {error}; give whole numbers in range") from error
