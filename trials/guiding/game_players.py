"""Players of the game at rest: a simulated driver on the glove's program, and a person with a joystick of this computer."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from waychair.control.haptics.patterns import TouchVocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.errors import GloveError
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.messages import Hand, PlayStep
from waychair.firmware_bridge.glove.program import GloveConfig, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting, check_port, transport_from_text
from waychair.simulation.rider.blind_driver import BlindDriver, DriverModel
from waychair.types import JoystickInput

TICK_NS = 20_000_000

READY_S = 3.0
"""s within which a glove must answer."""

VALID_MS = 500

_EVENT = struct.Struct("<IhBB")
"""An event of Linux's joystick interface: time, value, type, number (linux/joystick.h)."""

_AXIS = 2
_FULL = 32767.0


class SimulatedPlayer:
    """A simulated driver who feels the glove's program on this computer, in lockstep."""

    def __init__(self, glove: HostGlove, bridge: GloveBridge, driver: BlindDriver) -> None:
        self._glove, self._bridge, self._driver = glove, bridge, driver
        self._now_ns = 0

    @property
    def now_ns(self) -> int:
        """The simulated time."""
        return self._now_ns

    def tick(self) -> JoystickInput:
        """See `Player`."""
        self._now_ns += TICK_NS
        self._bridge.tick(self._now_ns, armed=False)
        return self._driver.step(self._now_ns, self._glove.step(self._now_ns // 1_000_000))

    def play(self, steps: Sequence[PlayStep], priority: int) -> str:
        """See `Player`."""
        return self._bridge.play(steps, priority, VALID_MS, self._now_ns)


class LivePlayer:
    """A person with a glove on a port and a joystick of this computer, which moves no chair."""

    def __init__(self, bridge: GloveBridge, stick: int) -> None:
        """`stick`: the descriptor of a Linux joystick, such as /dev/input/js0, that does not block."""
        self._bridge, self._stick = bridge, stick
        self._axes = [0.0, 0.0]  # to the right, to the rear

    @property
    def now_ns(self) -> int:
        """The computer's steady clock."""
        return time.monotonic_ns()

    def tick(self) -> JoystickInput:
        """See `Player`."""
        time.sleep(TICK_NS * 1e-9)
        self._bridge.tick(self.now_ns, armed=False)
        self._read()
        return JoystickInput(self.now_ns, -self._axes[1], -self._axes[0])

    def play(self, steps: Sequence[PlayStep], priority: int) -> str:
        """See `Player`."""
        return self._bridge.play(steps, priority, VALID_MS, self.now_ns)

    def _read(self) -> None:
        while True:
            try:
                event = os.read(self._stick, _EVENT.size)
            except BlockingIOError:
                return
            except OSError as error:
                raise GloveError(f"the joystick is lost ({error.strerror}): plug it in again") from error
            if len(event) < _EVENT.size:
                return
            _, value, kind, number = _EVENT.unpack(event)
            if kind & _AXIS and number < len(self._axes):
                self._axes[number] = value / _FULL


@contextmanager
def simulated_player(
    profile: HapticsProfile, words: TouchVocabulary, model: DriverModel, seed: int
) -> Iterator[SimulatedPlayer]:
    """Yield a simulated player whose glove is ready.

    Raises:
        BoardBuildError: the glove's program cannot be built or started.
        GloveError: the profile is for another layout.
    """
    config = GloveConfig(profile.device_id, profile.layout, Hand[profile.hand.upper()])
    with HostGlove(glove_program(), config) as glove:
        transport = glove.transport
        bridge = GloveBridge(Reconnecting(lambda: transport), profile.device_id, words.layout, profile.fitting())
        player = SimulatedPlayer(glove, bridge, BlindDriver(words.layout, words.steps(), model, seed))
        _wait_until_ready(player, bridge)
        yield player


@contextmanager
def live_player(profile: HapticsProfile, port: str, stick: Path) -> Iterator[LivePlayer]:
    """Yield a person's player whose glove is ready.

    Raises:
        TransportError: the port's name has no known form.
        GloveError: the glove does not answer or cannot be used, or there is no such joystick.
    """
    check_port(port, "--port")
    try:
        descriptor = os.open(stick, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        raise GloveError(
            f"the joystick {stick} cannot be opened ({error.strerror}): name one of /dev/input/js*"
        ) from error
    cable = Reconnecting(lambda: transport_from_text(port, "--port"))
    try:
        bridge = GloveBridge(cable, profile.device_id, layout_named(profile.layout), profile.fitting())
        player = LivePlayer(bridge, descriptor)
        _wait_until_ready(player, bridge)
        yield player
    finally:
        cable.close()
        os.close(descriptor)


def _wait_until_ready(player: SimulatedPlayer | LivePlayer, bridge: GloveBridge) -> None:
    until_ns = player.now_ns + round(READY_S * 1e9)
    while bridge.problem(player.now_ns) and player.now_ns < until_ns:
        player.tick()
    problem = bridge.problem(player.now_ns)
    if problem:
        raise GloveError(problem)
