"""Players of the game at rest: a simulated driver on the glove's program, and a person with a joystick of this computer."""

from __future__ import annotations

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
from waychair.trials.live.computer_joystick import ComputerJoystick
from waychair.types import JoystickInput

TICK_NS = 20_000_000

READY_S = 3.0
"""s within which a glove must answer."""

VALID_MS = 500


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

    def __init__(self, bridge: GloveBridge, stick: ComputerJoystick) -> None:
        self._bridge, self._stick = bridge, stick

    @property
    def now_ns(self) -> int:
        """The computer's steady clock."""
        return time.monotonic_ns()

    def tick(self) -> JoystickInput:
        """See `Player`."""
        time.sleep(TICK_NS * 1e-9)
        self._bridge.tick(self.now_ns, armed=False)
        return self._stick.read(self.now_ns)

    def play(self, steps: Sequence[PlayStep], priority: int) -> str:
        """See `Player`."""
        return self._bridge.play(steps, priority, VALID_MS, self.now_ns)


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
        GloveError: the glove does not answer or cannot be used.
        JoystickError: there is no such joystick.
    """
    check_port(port, "--port")
    joystick = ComputerJoystick(stick)
    cable = Reconnecting(lambda: transport_from_text(port, "--port"))
    try:
        bridge = GloveBridge(cable, profile.device_id, layout_named(profile.layout), profile.fitting())
        player = LivePlayer(bridge, joystick)
        _wait_until_ready(player, bridge)
        yield player
    finally:
        cable.close()
        joystick.close()


def _wait_until_ready(player: SimulatedPlayer | LivePlayer, bridge: GloveBridge) -> None:
    until_ns = player.now_ns + round(READY_S * 1e9)
    while bridge.problem(player.now_ns) and player.now_ns < until_ns:
        player.tick()
    problem = bridge.problem(player.now_ns)
    if problem:
        raise GloveError(problem)
