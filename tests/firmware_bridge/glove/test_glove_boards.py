"""The ESP32 gloves compiled against shims of the Arduino core, and run on a fake: PWM, and DRV2605L behind a multiplexer.

They have not run on hardware.
"""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path

import pytest

from tests.firmware_bridge.glove.rig import LIMIT
from tests.firmware_bridge.rig import STRICT
from waychair.errors import BoardBuildError
from waychair.firmware_bridge.board import FIRMWARE, compile_c
from waychair.firmware_bridge.glove.messages import (
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
from waychair.firmware_bridge.glove.program import GLOVE_FIRMWARE

SHIMS = Path(__file__).parents[1] / "shims"
NAMED = ('-DGLOVE_ID="A"', "-DGLOVE_LAYOUT=1", "-DGLOVE_MOTORS=9", "-DGLOVE_HAND=HAND_LEFT")
"""The lines that a builder writes into the sketch."""

PIN_REPEAT, PIN_YES, PIN_WORN, PIN_TEMPERATURE, PIN_ENABLE = 32, 33, 35, 36, 23
BOTH = ("motors_pwm", "motors_drv2605")


def build(folder: Path, motors: str, named: tuple[str, ...] = NAMED) -> Path:
    """A library of the glove with this way to drive its motors."""
    built = folder / f"{motors}.so"
    esp32 = GLOVE_FIRMWARE / "esp32"
    sources = [
        FIRMWARE / "frame.c",
        *GLOVE_FIRMWARE.glob("*.c"),
        *(esp32 / f"{n}.c" for n in ("hal_esp32", "sketch", motors)),
    ]
    flags = [*STRICT, LIMIT, "-g", "-fPIC", "-shared", f"-I{SHIMS}", f"-I{GLOVE_FIRMWARE}", f"-I{esp32}", *named]
    compile_c([*flags, *map(str, sources), str(Path(__file__).with_name("fake_esp32.c")), "-o", str(built)])
    return built


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A library for each of the two."""
    folder = tmp_path_factory.mktemp("esp32_glove")
    return {motors: build(folder, motors) for motors in BOTH}


class Esp32Glove:
    """A glove on paper, worn at 25 C. Each copy of the library is a separate glove."""

    def __init__(self, folder: Path, built: Path) -> None:
        self.library = ctypes.CDLL(str(shutil.copy(built, folder / "glove.so")))
        self.drives = built.stem
        self.sequence = 0
        self.decoder = GloveDecoder()
        self.read = 0
        self.heard: list[GloveMessage] = []
        self.pins()[PIN_WORN] = self.pins()[PIN_REPEAT] = self.pins()[PIN_YES] = 1
        self.millivolts()[PIN_TEMPERATURE] = 750

    def number(self, name: str) -> ctypes.c_uint32:
        """A variable of the fake."""
        return ctypes.c_uint32.in_dll(self.library, name)

    def pins(self) -> ctypes.Array[ctypes.c_uint8]:
        """Levels of the pins."""
        return (ctypes.c_uint8 * 40).in_dll(self.library, "fake_pins")

    def millivolts(self) -> ctypes.Array[ctypes.c_uint32]:
        """Voltages of the analogue inputs."""
        return (ctypes.c_uint32 * 40).in_dll(self.library, "fake_mv")

    def motors(self) -> list[int]:
        """The level of each motor, by PWM or in the driver's register."""
        if self.drives == "motors_pwm":
            return list((ctypes.c_uint8 * 9).in_dll(self.library, "fake_duty"))
        registers = (ctypes.c_uint8 * 0x24 * 16).in_dll(self.library, "fake_drivers")
        return [registers[motor][2] for motor in range(9)]

    def boot(self) -> None:
        self.library.setup()

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.number("fake_ms").value += 1
            self.library.loop()
        end = self.number("fake_tx_end").value
        sent = bytes((ctypes.c_uint8 * 8192).in_dll(self.library, "fake_tx"))[:end]
        self.number("fake_tx_end").value = 0
        self.heard += [received.message for received in self.decoder.feed(sent)]

    def send(self, *messages: GloveMessage) -> None:
        for message in messages:
            self.sequence += 1
            data = encode_glove(message, self.sequence)
            end = self.number("fake_rx_end")
            target = ctypes.addressof(ctypes.c_uint8.in_dll(self.library, "fake_rx"))
            ctypes.memmove(target + end.value, data, len(data))
            end.value += len(data)

    def play(self, mask: int, on_ms: int = 200) -> None:
        self.send(Play(100, 500, (PlayStep(mask, 200, on_ms, 0),)))

    def status(self) -> GloveStatus:
        """The last report, 50 ms later."""
        self.send(Alive(0))
        self.run(51)
        return [message for message in self.heard if isinstance(message, GloveStatus)][-1]


@pytest.fixture(params=BOTH)
def esp32(request: pytest.FixtureRequest, libraries: dict[str, Path], tmp_path: Path) -> Esp32Glove:
    """A glove that is not switched on yet."""
    return Esp32Glove(tmp_path, libraries[request.param])


def greeted(glove: Esp32Glove) -> Esp32Glove:
    glove.boot()
    glove.send(glove_hello("A", 1))
    glove.run(1)
    return glove


def test_a_glove_boots_at_rest_and_answers_with_its_name_and_hand(esp32: Esp32Glove) -> None:
    greeted(esp32)
    (reply,) = [message for message in esp32.heard if isinstance(message, GloveReply)]
    assert (reply.refused, reply.motors, reply.hand) == (0, 9, Hand.LEFT)
    assert esp32.motors() == [0] * 9
    assert (esp32.number("fake_watchdog_ms").value, esp32.number("fake_watched").value) == (100, 1)
    assert esp32.number("fake_kicks").value == 1


def test_a_pattern_drives_its_motors_and_no_others(esp32: Esp32Glove) -> None:
    greeted(esp32)
    esp32.play(0b1_0000_0001, 50)
    esp32.run(1)
    assert esp32.motors() == [200, 0, 0, 0, 0, 0, 0, 0, 200]
    esp32.run(49)
    assert esp32.motors()[0] == 200
    esp32.run(1)
    assert esp32.motors() == [0] * 9


def test_sensors_and_buttons_are_reported(esp32: Esp32Glove) -> None:
    greeted(esp32)
    esp32.pins()[PIN_YES] = 0
    status = esp32.status()
    assert (status.worn, status.temperature_c, status.repeat_presses, status.yes_presses) == (1, 25, 0, 1)
    esp32.pins()[PIN_WORN] = 0
    esp32.pins()[PIN_REPEAT] = 0
    esp32.millivolts()[PIN_TEMPERATURE] = 900
    status = esp32.status()
    assert (status.worn, status.temperature_c, status.repeat_presses) == (0, 40, 1)
    for millivolts in (0, 3300):  # no sensor, or a short
        esp32.millivolts()[PIN_TEMPERATURE] = millivolts
        assert esp32.status().temperature_c == 127


def test_open_and_shorted_motors_are_found(esp32: Esp32Glove) -> None:
    esp32.number("fake_open").value = 1 << 2
    esp32.number("fake_shorted").value = 1 << 5
    greeted(esp32)
    for motor in range(9):
        esp32.play(1 << motor, 60)
        esp32.run(70)
    status = esp32.status()
    assert (status.open_motors, status.shorted_motors) == (1 << 2, 1 << 5)
    esp32.play(1 << 5)
    esp32.run(1)
    assert esp32.motors() == [0] * 9


def test_motors_of_equal_level_are_written_at_once(libraries: dict[str, Path], tmp_path: Path) -> None:
    glove = greeted(Esp32Glove(tmp_path, libraries["motors_drv2605"]))
    before = glove.number("fake_writes").value
    glove.play(0b1_1111_1111)
    glove.run(1)
    assert glove.motors() == [200] * 9
    assert glove.number("fake_writes").value - before == 3  # two multiplexers and one level: 0.3 ms
    glove.run(50)
    assert glove.number("fake_writes").value - before == 3


def test_a_bus_that_dies_takes_the_drivers_their_enable(libraries: dict[str, Path], tmp_path: Path) -> None:
    glove = greeted(Esp32Glove(tmp_path, libraries["motors_drv2605"]))
    assert glove.pins()[PIN_ENABLE] == 1
    glove.play(1 << 3)
    glove.run(5)
    glove.number("fake_bus_dead").value = 1
    glove.run(250)
    assert glove.pins()[PIN_ENABLE] == 0
    assert glove.status().open_motors == 0x1FF


def test_a_glove_without_drivers_says_that_all_motors_are_open(libraries: dict[str, Path], tmp_path: Path) -> None:
    glove = Esp32Glove(tmp_path, libraries["motors_drv2605"])
    glove.number("fake_bus_dead").value = 1
    greeted(glove)
    assert glove.status().open_motors == 0x1FF
    assert glove.pins()[PIN_ENABLE] == 0


def test_a_glove_without_a_name_is_not_compiled(tmp_path: Path) -> None:
    with pytest.raises(BoardBuildError, match="write the glove's name, layout, motors and hand"):
        build(tmp_path, "motors_pwm", NAMED[1:])


def test_the_sketch_is_compiled_with_the_protocols_longest_payload() -> None:
    assert (GLOVE_FIRMWARE / "esp32" / "build_opt.h").read_text().split() == [LIMIT]
