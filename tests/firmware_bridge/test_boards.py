"""The ESP32 boards compiled against shims of the Arduino core, and run on a fake: drive, cut, EEPROM, lost converter."""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.rig import STRICT
from waychair.firmware_bridge.board import FIRMWARE, compile_c
from waychair.firmware_bridge.protocol import (
    BoardFault,
    BoardState,
    BoardTelemetry,
    Command,
    Decoder,
    Family,
    HelloReply,
    Holder,
    Message,
    encode,
    hello,
)

SHIMS = Path(__file__).with_name("shims")
NAMED = ('-DCHAIR_ID="A"', "-DCHAIR_FAMILY=FAMILY_HALL_5V")
"""The lines that a builder writes into the sketch."""

PIN_SWITCH, PIN_CUT, PIN_ESTOP = 16, 17, 27


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A library for each of the two converters."""
    built = {}
    for dac in ("dac_internal", "dac_mcp4728"):
        built[dac] = tmp_path_factory.mktemp("esp32") / f"{dac}.so"
        sources = [*FIRMWARE.glob("*.c"), *(FIRMWARE / "esp32" / f"{n}.c" for n in ("hal_esp32", "sketch", dac))]
        flags = [*STRICT, "-g", "-fPIC", "-shared", f"-I{SHIMS}", f"-I{FIRMWARE}", f"-I{FIRMWARE / 'esp32'}", *NAMED]
        compile_c([*flags, *map(str, sources), str(SHIMS / "fake_esp32.c"), "-o", str(built[dac])])
    return built


class Esp32:
    """A board on paper: its library, its clock, its serial line. Each copy of the library is a separate board."""

    def __init__(self, folder: Path, built: Path) -> None:
        library = shutil.copy(built, folder / "board.so")
        self.library = ctypes.CDLL(str(library))
        self.sequence = 0
        self._decoder = Decoder()
        self._read = 0
        self.pins()[PIN_ESTOP] = 1

    def number(self, name: str) -> ctypes.c_uint32:
        """A variable of the fake."""
        return ctypes.c_uint32.in_dll(self.library, name)

    def pins(self) -> ctypes.Array[ctypes.c_uint8]:
        """Levels of the pins."""
        return (ctypes.c_uint8 * 40).in_dll(self.library, "fake_pins")

    def registers(self) -> ctypes.Array[ctypes.c_uint8]:
        """Of the MCP4728."""
        return (ctypes.c_uint8 * 24).in_dll(self.library, "fake_registers")

    def counts(self) -> list[int]:
        """The bytes sent to the converter."""
        return list((ctypes.c_uint16 * 2).in_dll(self.library, "fake_counts"))

    def send(self, message: Message) -> None:
        """A frame arrives."""
        data = encode(message, self.sequence)
        self.sequence += 1
        end = self.number("fake_rx_end")
        ctypes.memmove(ctypes.addressof(ctypes.c_uint8.in_dll(self.library, "fake_rx")) + end.value, data, len(data))
        end.value += len(data)

    def run(self, ms: int, forward: int = 0, turn: int = 0) -> None:
        """Commands every 20 ms for so long."""
        clock = ctypes.c_ulong.in_dll(self.library, "fake_ms")
        for tick in range(ms):
            if tick % 20 == 0:
                self.send(Command(forward, turn, 1, 0))
            clock.value += 1
            self.library.loop()
            self.library.loop()  # again within the millisecond: nothing happens
            if self.number("fake_rx_end").value > 7000:
                self.number("fake_rx_at").value = self.number("fake_rx_end").value = 0
            if self.number("fake_tx_end").value > 7000:
                self.heard()

    def heard(self) -> list[Message]:
        """Return the bytes that the board has sent since the last call."""
        end = self.number("fake_tx_end")
        start = ctypes.addressof(ctypes.c_uint8.in_dll(self.library, "fake_tx"))
        data, end.value = ctypes.string_at(start, end.value), 0
        return [received.message for received in self._decoder.feed(data)]

    def state(self) -> BoardTelemetry:
        """The last telemetry."""
        last = self.heard()[-1]
        assert isinstance(last, BoardTelemetry)
        return last


@pytest.mark.parametrize(("dac", "bits", "top"), [("dac_internal", 8, 255), ("dac_mcp4728", 12, 4095)])
def test_the_board_greets_arms_drives_and_releases_the_lines(
    tmp_path: Path, libraries: dict[str, Path], dac: str, bits: int, top: int
) -> None:
    board = Esp32(tmp_path, libraries[dac])
    board.library.setup()
    assert (board.pins()[PIN_SWITCH], board.pins()[PIN_CUT]) == (0, 1)
    assert board.counts() == [round((2500 - 1100) * top / 2800)] * 2
    board.send(hello("A", Family.HALL_5V))
    board.run(2)
    reply = board.heard()[0]
    assert isinstance(reply, HelloReply)
    assert (reply.refused, reply.dac_bits, reply.dac_counts_max) == (0, bits, top)
    board.run(2060)
    assert board.state().state == BoardState.ARMED
    board.run(400, 10000, -5000)
    assert board.pins()[PIN_SWITCH] == 1
    state = board.state()
    assert (state.state, state.holder, state.faults) == (BoardState.DRIVE, Holder.BOARD, 0)
    assert [abs(count - (mv - 1100) * top / 2800) < 1 for count, mv in zip(board.counts(), (3700, 1900), strict=True)]
    assert abs(state.forward_mv - 3700) < 12
    board.run(20)
    clock = ctypes.c_ulong.in_dll(board.library, "fake_ms")
    for _ in range(100):
        clock.value += 1
        board.library.loop()
    assert (board.pins()[PIN_SWITCH], board.pins()[PIN_CUT]) == (0, 1)
    assert board.state().faults == BoardFault.HOST_SILENT
    assert board.number("fake_kicks").value >= 250


@pytest.mark.parametrize("dac", ["dac_internal", "dac_mcp4728"])
def test_a_booting_board_leaves_the_lines_at_the_joystick_and_never_cuts_them(
    tmp_path: Path, libraries: dict[str, Path], dac: str
) -> None:
    board = Esp32(tmp_path, libraries[dac])
    board.library.setup()
    board.run(5)
    assert (board.pins()[PIN_SWITCH], board.pins()[PIN_CUT]) == (0, 1)
    assert board.number("fake_cuts").value == 0


def test_the_e_stop_pin_opens_the_cut_relay(tmp_path: Path, libraries: dict[str, Path]) -> None:
    board = Esp32(tmp_path, libraries["dac_internal"])
    board.library.setup()
    board.send(hello("A", Family.HALL_5V))
    board.run(2100)
    board.run(100, 5000)
    board.pins()[PIN_ESTOP] = 0
    board.run(1, 5000)
    assert (board.pins()[PIN_SWITCH], board.pins()[PIN_CUT]) == (0, 0)
    board.run(20)
    assert board.state().faults == BoardFault.ESTOP


def test_f29_neutral_is_written_to_the_eeprom_once_and_verified_at_boot(
    tmp_path: Path, libraries: dict[str, Path]
) -> None:
    board = Esp32(tmp_path, libraries["dac_mcp4728"])
    board.library.setup()
    assert board.number("fake_eeprom_writes").value == 1
    neutral = round((2500 - 1100) * 4095 / 2800)
    for channel in (0, 1):
        assert list(board.registers()[6 * channel + 4 : 6 * channel + 6]) == [neutral >> 8, neutral & 0xFF]
    board.library.setup()
    assert board.number("fake_eeprom_writes").value == 1
    board.registers()[10] ^= 1  # channel B would wake up elsewhere
    board.library.setup()
    assert board.number("fake_eeprom_writes").value == 2


def test_f29_a_worn_eeprom_or_a_silent_converter_is_a_board_fault(tmp_path: Path, libraries: dict[str, Path]) -> None:
    board = Esp32(tmp_path, libraries["dac_mcp4728"])
    board.number("fake_eeprom_worn").value = 1
    board.library.setup()
    board.send(hello("A", Family.HALL_5V))
    board.run(2200)
    state = board.state()
    assert (state.state, state.faults, state.holder) == (BoardState.FAULT, BoardFault.BOARD, Holder.JOYSTICK)
    board.number("fake_eeprom_worn").value = 0
    board.number("fake_i2c_dead").value = 1
    board.library.setup()
    board.run(40)
    assert board.state().faults == BoardFault.BOARD


def test_f29_a_converter_lost_during_a_drive_gives_the_lines_to_the_joystick(
    tmp_path: Path, libraries: dict[str, Path]
) -> None:
    board = Esp32(tmp_path, libraries["dac_mcp4728"])
    board.library.setup()
    board.send(hello("A", Family.HALL_5V))
    board.run(2100)
    board.run(300, 8000)
    assert board.pins()[PIN_SWITCH] == 1
    board.number("fake_i2c_dead").value = 1
    board.run(22, 8000)
    assert board.pins()[PIN_SWITCH] == 0
    assert board.state().faults == BoardFault.BOARD


@pytest.mark.parametrize("source", sorted((FIRMWARE / "esp32").glob("*.c")))
def test_sources_never_tested_on_hardware_say_so(source: Path) -> None:
    head = source.read_text().split("*/")[0]
    assert "NOT" in head
    assert "RUN ON" in head
    assert "HARDWARE" in head
