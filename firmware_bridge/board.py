"""The shipped firmware as a process on this computer: build it, start it on a pseudo-terminal, step it in lockstep.

`HostBoard` stands for the board in a simulation. The bridge talks to `HostBoard.transport` (or opens `HostBoard.path`
from another process). The simulator calls `step` with its time and the rider's stick, and gets the voltages of the
chair's lines. The C code is the code that is flashed; only the hardware around it is a model
(`firmware/host/hardware.c`), which can simulate defects.
"""

from __future__ import annotations

import enum
import hashlib
import os
import select
import shutil
import signal
import struct
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Self

from waychair.config import Settings, setting
from waychair.errors import BoardBuildError, BridgeError
from waychair.files import cache_folder, replacing
from waychair.firmware_bridge.protocol import BoardFault, BoardState, Family, Holder
from waychair.firmware_bridge.transports import DescriptorTransport, open_pseudo_terminal

FIRMWARE = Path(__file__).resolve().parent / "firmware"

C_FLAGS = ("-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")

TIMEOUT_S = 30.0
"""Timeout in real time for the program's answer to a step, long enough for a computer on which many programs wait."""

_REQUEST = struct.Struct("<IIHHHBBBxh")
_ANSWER = struct.Struct("<IIHHBBH")


class Defect(enum.IntEnum):
    """A defect of the hardware around the microcontroller; axis 0 is forward, 1 turn."""

    NONE = 0
    STUCK = 1  # the converter keeps its last voltage on the axis
    OFFSET = 2  # `value` mV are added to the converter's axis
    OPEN = 3  # the axis' wire is broken; the line is pulled to the reference
    LOW = 4  # the axis is shorted to ground
    HIGH = 5  # the axis is shorted to the supply
    SWAP = 6  # the two lines are swapped
    BRIDGE = 7  # the two lines are shorted to each other
    STICK_OPEN = 8  # the axis' wire to the rider's stick is broken
    CONVERTER_SILENT = 9  # the converter does not answer and keeps its voltages
    WELDED = 10  # the line switch stays where it is
    FROZEN = 11  # the firmware hangs
    BROWN_OUT = 12  # the board has no power; it boots when this ends


@dataclass(frozen=True, slots=True)
class BoardSettings(Settings):
    """The configuration stored on the board: chair, joystick family and limits; the computer cannot change it."""

    chair_id: str = setting("A", "", "name of the chair to which this board belongs, at most 16 bytes")
    family: int = setting(
        Family.HALL_5V, "", "number of the chair's joystick family in firmware/families.c", low=0, high=255
    )
    dac_bits: int = setting(
        12, "bits", "resolution of the board's D/A converter; larger: finer steps of the joystick lines", low=8, high=16
    )
    neutral_per_mille: int = setting(
        100,
        "1/1000 swing",
        "deflection up to which the rider's stick is at rest; larger: lighter touches are ignored",
        low=20,
        high=200,
    )
    override_per_mille: int = setting(
        200,
        "1/1000 swing",
        "deflection beyond which the rider's stick takes over; larger: more tremor is tolerated",
        low=21,
        high=800,
    )
    override_ms: int = setting(
        10,
        "ms",
        "time beyond the override deflection before the stick takes over; larger: longer spasms are tolerated",
        low=0,
        high=500,
    )
    guard_lost_per_mille: int = setting(
        250,
        "1/1000 swing",
        "highest deflection that a guard lets pass once the computer is lost; larger: faster, 1000 for a rider who sees",
        low=0,
        high=1000,
    )


@dataclass(frozen=True, slots=True)
class BoardInputs:
    """The board's inputs: the rider's stick and the chair's reference line [mV], the e-stop, and one defect."""

    joystick_forward_mv: int
    joystick_turn_mv: int
    reference_mv: int
    estop_released: bool = True
    defect: Defect = Defect.NONE
    defect_axis: int = 0
    defect_value: int = 0


@dataclass(frozen=True, slots=True)
class LineState:
    """The line voltages at the chair's controller [mV], the holder of the lines, and the firmware's state."""

    forward_mv: int
    turn_mv: int
    holder: Holder
    state: BoardState
    faults: BoardFault


REFERENCE_MV: Mapping[int, int] = MappingProxyType(
    {Family.NONE: 2500, Family.HALL_5V: 2500, Family.INDUCTIVE_12V: 5800, Family.EIGHT_PIN_3V3: 1650}
)
"""Nominal voltage of each family's reference line, as in `firmware/families.c`."""


def at_rest(family: int = Family.HALL_5V) -> BoardInputs:
    """Return inputs without any defect and with the stick at rest."""
    reference_mv = REFERENCE_MV[family]
    return BoardInputs(reference_mv, reference_mv, reference_mv)


def build_board(folder: Path) -> Path:
    """Return the program `waychair_board`, built into `folder` unless one of the same sources is there already.

    Raises:
        BoardBuildError: there is no C compiler, or it refuses the sources.
        OutputError: the folder cannot be written to.
    """
    sources = [*FIRMWARE.glob("*.c"), *(FIRMWARE / "host").glob("*.c")]
    headers = [*FIRMWARE.glob("*.h"), *(FIRMWARE / "host").glob("*.h")]
    return build_program("waychair_board", folder, sources, headers, C_FLAGS)


def build_program(
    name: str, folder: Path, sources: Iterable[Path], headers: Iterable[Path], flags: Sequence[str]
) -> Path:
    """Return the program of these sources, built into `folder` unless it is there already; raises as `build_board`."""
    digest = hashlib.sha256(" ".join(flags).encode())
    for path in (*sorted(sources), *sorted(headers)):
        digest.update(path.name.encode() + path.read_bytes())
    program = folder / f"{name}-{digest.hexdigest()[:16]}"
    if os.access(program, os.X_OK):
        return program
    with replacing(program) as aside:
        compile_c([*flags, *map(str, sorted(sources)), "-o", str(aside)])
    program.chmod(0o755)
    return program


def board_program() -> Path:
    """Return the program, built into the user's cache at its first use.

    Raises:
        BoardBuildError: there is no C compiler, or it refuses the sources.
        OutputError: the cache cannot be written to.
    """
    return build_board(cache_folder())


def compile_c(arguments: list[str]) -> None:
    """Run the system's C compiler.

    Raises:
        BoardBuildError: there is no compiler, or it reports an error.
    """
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise BoardBuildError(
            "no C compiler was found to build the board's firmware with: install gcc or clang "
            "(`sudo apt install gcc`), or name one in the variable CC"
        )
    try:
        done = subprocess.run([compiler, *arguments], capture_output=True, text=True, check=False)
    except OSError as error:
        raise BoardBuildError(f"the C compiler {compiler} cannot be run: {error.strerror}; set CC") from error
    if done.returncode != 0:
        raise BoardBuildError(f"{compiler} refused the firmware: {done.stderr.strip()[-2000:]}; repair the sources")


class LockstepTransport(DescriptorTransport):
    """The computer's end of a board's terminal; it counts the bytes written and the bytes to be received.

    A pseudo-terminal delivers bytes a little later than it accepts them; with the counts each side waits for the other's
    bytes.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
        self.written = 0
        self.expected = 0
        self._received = 0

    def write(self, data: bytes) -> bool:
        """Send all bytes; a partial write is not counted."""
        accepted = super().write(data)
        if accepted:
            self.written = (self.written + len(data)) & 0xFFFFFFFF
        return accepted

    def read(self) -> bytes:
        """Return all bytes that the board sent up to its last step."""
        data = b""
        while (missing := (self.expected - self._received) & 0xFFFFFFFF) and not self.closed:
            ready, _, _ = select.select([self], [], [], TIMEOUT_S)
            part = super().read() if ready else b""
            if not part or missing > 0x7FFFFFFF:
                break
            self._received = (self._received + len(part)) & 0xFFFFFFFF
            data += part
        return data


class HostBoard:
    """A running board, as a context manager. It starts with the joystick live, as every board does.

    A dead board raises no error: without power its switch falls back to the joystick.
    """

    def __init__(self, program: Path, settings: BoardSettings | None = None) -> None:
        """
        Raises:
            BoardBuildError: the program cannot be started.
            TransportError: the system has no pseudo-terminal left.
        """
        self.settings = settings or BoardSettings()
        board, computer, self.path = open_pseudo_terminal()
        self._requests, self._answers = os.pipe(), os.pipe()
        self._computer = computer
        self.transport = LockstepTransport(os.dup(computer))
        try:
            self._process = self._start(program, board)
        except OSError as error:
            self._release()
            raise BoardBuildError(f"cannot start {program}: {error.strerror}; build the board again") from error
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
        """Whether the board has power, that is, its program runs."""
        return self._process.poll() is None

    def step(self, now_ms: int, inputs: BoardInputs) -> LineState:
        """Run the board up to `now_ms` (modulo 2^32), a millisecond at a time; return the lines at that moment.

        The board first waits for all bytes written to `transport`, so that the same calls give the same answers. A step
        of 0, backwards, or of more than a second is a jump of the board's clock. The timing of another process on `path`
        is not deterministic.

        Raises:
            BridgeError: the program runs but does not answer, or a voltage lies outside 0..65535 mV.
        """
        answer = self._exchange(_request(now_ms, self.transport.written, inputs))
        if answer is None:
            return _unpowered(inputs)
        sent, _, forward, turn, holder, state, faults = _ANSWER.unpack(answer)
        self.transport.expected = sent
        return LineState(forward, turn, Holder(holder), BoardState(state), BoardFault(faults))

    def kill(self) -> None:
        """Remove the board's power at once and for good."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """End the program and close its descriptors."""
        if self._process.poll() is None:
            self.kill()
        self._release()

    def _release(self) -> None:
        self.transport.close()
        for descriptor in (self._computer, self._requests[1], self._answers[0]):
            os.close(descriptor)

    def _start(self, program: Path, board: int) -> subprocess.Popen[bytes]:
        settings, requests, answers = self.settings, self._requests[0], self._answers[1]
        options = {
            "--serial-fd": board,
            "--lockstep": f"{requests},{answers}",
            "--family": settings.family,
            "--chair": settings.chair_id,
            "--dac-bits": settings.dac_bits,
            "--neutral": settings.neutral_per_mille,
            "--override": settings.override_per_mille,
            "--override-ms": settings.override_ms,
            "--guard-lost": settings.guard_lost_per_mille,
        }
        os.set_blocking(board, False)
        words = [str(word) for option in options.items() for word in option]
        return subprocess.Popen(
            [str(program), *words],
            pass_fds=(board, requests, answers),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )

    def _exchange(self, request: bytes) -> bytes | None:
        """Return the program's answer; None if the program has ended."""
        return exchange(self._requests[1], self._answers[0], request, _ANSWER.size)


def exchange(requests: int, answers: int, request: bytes, size: int) -> bytes | None:
    """Write a request to a program's descriptor and return its answer of `size` bytes; None if the program has ended.

    Raises:
        BridgeError: the program runs but does not answer.
    """
    answer = b""
    try:
        os.write(requests, request)
        while len(answer) < size:
            ready, _, _ = select.select([answers], [], [], TIMEOUT_S)
            if not ready:
                raise BridgeError(f"the board's program did not answer within {TIMEOUT_S:g} s: start it again")
            part = os.read(answers, size - len(answer))
            if not part:
                return None
            answer += part
    except BrokenPipeError:
        return None
    return answer


def _request(now_ms: int, written: int, inputs: BoardInputs) -> bytes:
    try:
        return _REQUEST.pack(
            now_ms & 0xFFFFFFFF,
            written,
            inputs.joystick_forward_mv,
            inputs.joystick_turn_mv,
            inputs.reference_mv,
            inputs.estop_released,
            inputs.defect,
            inputs.defect_axis,
            inputs.defect_value,
        )
    except struct.error as error:
        raise BridgeError(f"{inputs} cannot be given to the board: {error}; give whole millivolts") from error


def _unpowered(inputs: BoardInputs) -> LineState:
    """Return the lines of a board without power: at the joystick, unless the e-stop's contact has cut them."""
    if not inputs.estop_released:
        reference = inputs.reference_mv
        return LineState(reference, reference, Holder.CUT, BoardState.SILENT, BoardFault(0))
    forward, turn = inputs.joystick_forward_mv, inputs.joystick_turn_mv
    return LineState(forward, turn, Holder.JOYSTICK, BoardState.SILENT, BoardFault(0))
