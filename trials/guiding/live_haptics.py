"""Glove, voice and rider of a simulated chair that runs live: the glove's program on this computer, or a glove on a port.

    with open_haptics(options, body, grid, zones, seed) as parts:
        parts.guide                      # for the chair
        parts.beat(simulator)            # every heartbeat

With a `driver` a simulated one feels the motors and moves the chair's own joystick; otherwise a person does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.paper_preset import paper_codes
from waychair.control.haptics.patterns import TouchVocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.messages import Hand
from waychair.firmware_bridge.glove.program import GloveConfig, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting, check_port, transport_from_text
from waychair.maps.drawn.zones import Zone
from waychair.runtime.haptics.haptic_guide import HapticGuide
from waychair.runtime.haptics.haptic_state import RiderSurroundings
from waychair.runtime.haptics.learnt_file import load_learner, save_learner
from waychair.runtime.haptics.session_log import SessionCounter, SessionLog
from waychair.runtime.haptics.sounds import Sounds
from waychair.runtime.haptics.teller import Teller
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.rider.blind_driver import BlindDriver, DriverModel, Learnt
from waychair.simulation.rider.driver_presets import driver_named
from waychair.simulation.simulator import Simulator
from waychair.trials.drive import DriveSetup
from waychair.trials.guiding.sound_track import SoundTrack
from waychair.types import OccupancyGrid


@dataclass(frozen=True, slots=True)
class HapticOptions:
    """Channels to a rider: the rider's profile, the file of learnt numbers (None to forget them at the end), and the trainer's
    record, None without one.

    `port` of a glove, None for its program on this computer. `driver`: the preset of a simulated driver who feels it, None
    for a person. `words`: other patterns than those of the profile's layout. `track`: takes in all sounds instead of this
    computer's loudspeaker.
    """

    profile: HapticsProfile = field(default_factory=HapticsProfile)
    learnt: Path | None = None
    session: SessionLog | None = None
    port: str | None = None
    driver: str | None = None
    words: TouchVocabulary | None = None
    track: SoundTrack | None = None


class HapticParts:
    """The parts of one chair; a chair without them has a `guide` of None. `glove` is the program on this computer, if any."""

    def __init__(
        self,
        guide: HapticGuide | None = None,
        glove: HostGlove | None = None,
        driver: Callable[[Simulator], BlindDriver] | None = None,
        track: SoundTrack | None = None,
    ) -> None:
        self.guide = guide
        self._track = track
        self.glove = glove
        self.driver: BlindDriver | None = None
        self._make_driver = driver

    def tell_of(self, around: Callable[[], RiderSurroundings], touches: Callable[[], int]) -> None:
        """Ask this for the surroundings when the rider asks where the chair is, and for the contacts so far."""
        if self.guide is not None:
            self.guide.around = around
            if self.guide.session is not None:
                self.guide.session.touches = touches

    def beat(self, simulator: Simulator) -> None:
        """Let the glove's program run up to now; a simulated driver feels it and moves the joystick."""
        if self._track is not None:
            self._track.now_ns = simulator.now_ns
        if self.glove is None:
            return
        levels = self.glove.step(simulator.now_ns // 1_000_000)
        if self._make_driver is not None:
            self.driver = self.driver or self._make_driver(simulator)
            simulator.rider = self.driver.step(simulator.now_ns, levels)


@contextmanager
def open_haptics(
    options: HapticOptions,
    body: ChairBody,
    grid: OccupancyGrid,
    zones: Sequence[Zone] = (),
    seed: int = 0,
    *,
    apart: bool = True,
) -> Iterator[HapticParts]:
    """Yield the parts; on leaving, the rider's learnt numbers are saved. `apart`: steps are planned in a thread of their own.

    Raises:
        BoardBuildError: the glove's program cannot be built or started.
        GloveError, PatternError: the profile's layout, fitting or patterns are impossible.
        TransportError: the port's name has no known form.
        LearntError: the file of what was learnt is damaged.
        ConfigError: there is no such driver.
    """
    profile, layout = options.profile, layout_named(options.profile.layout)
    learner = load_learner(options.learnt)
    model = None if options.driver is None else driver_named(options.driver)
    with ExitStack() as ends:
        glove = None
        if options.port is None:
            config = GloveConfig(profile.device_id, profile.layout, Hand[profile.hand.upper()])
            glove = ends.enter_context(HostGlove(glove_program(), config))
            transport = glove.transport
            cable = Reconnecting(lambda: transport)
        else:
            port = options.port
            check_port(port, "--glove")
            cable = Reconnecting(lambda: transport_from_text(port, "--glove"))
            ends.callback(cable.close)
        sounds = Sounds(profile) if options.track is None else options.track.loudspeaker(profile)
        ends.callback(sounds.close)
        teller = Teller(
            profile, GloveBridge(cable, profile.device_id, layout, profile.fitting()), sounds, options.words
        )
        worker = ends.enter_context(ThreadPoolExecutor(1, "steps")) if apart else None
        session = None if options.session is None else SessionCounter(options.session)
        guide = HapticGuide(body, teller, learner, grid, zones, worker, session=session)

        def driver(simulator: Simulator) -> BlindDriver:
            assert model is not None
            used = used_to(model, simulator.settings.plant)
            if profile.as_paper:
                return BlindDriver(layout, paper_codes(), replace(used, tries_s=TRIES_S), seed)
            return BlindDriver(layout, learnt_words(teller.words), used, seed)

        yield HapticParts(guide, glove, None if model is None else driver, options.track)
        save_learner(options.learnt, guide.leader.learner)


@contextmanager
def haptics_of(
    options: HapticOptions | None, setup: DriveSetup, seed: int, *, apart: bool = True
) -> Iterator[HapticParts]:
    """Yield the parts for the chair of a setting, none without options; `apart` and errors as of `open_haptics`."""
    if options is None:
        yield HapticParts()
        return
    with open_haptics(options, setup.body, setup.grid, setup.zones, seed, apart=apart) as parts:
        yield parts


TRIES_S = 4.0
"""s at rest after which a driver whom the paper's signals lead to no place pushes ahead again. An assumption."""


def learnt_words(words: TouchVocabulary) -> Learnt:
    """Return a vocabulary as a driver has learnt it."""
    return {**words.steps(), **{f"obstacle {motor}": each.steps() for motor, each in words.obstacles.items()}}


def used_to(driver: DriverModel, plant: PlantSettings) -> DriverModel:
    """Return a driver who knows from which push on this chair begins to turn, and nudges by as much beyond it.

    An assumption: nobody is led by nudges before the hour with a trainer in which this is felt.
    """
    stiffer = (plant.turn_dead_band - PlantSettings().turn_dead_band) / plant.swing_volts
    return replace(driver, hand=replace(driver.hand, nudge=driver.hand.nudge + stiffer))
