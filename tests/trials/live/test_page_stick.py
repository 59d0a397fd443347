"""The page's stick of a simulated chair, from the page's message to the board: led and guarded like a rider's own; in lockstep."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

from tests.runtime.riding import hall
from waychair.control.haptics.profile import HapticsProfile
from waychair.runtime.haptics.haptic_guide import UNGUARDED
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.runtime.rider.sentences import sentence
from waychair.trials.drive import BEAT_NS, TICK_NS
from waychair.trials.guiding.live_haptics import HapticOptions
from waychair.trials.live.live_chair import LiveChair
from waychair.types import DriveMode, HelpLevel, Pose2
from waychair.ui.commands import obey

TICKS = 20
"""A second."""


@dataclass
class Page:
    """A page's messages to a chair whose loop runs in the test's own thread; `held` is what it sends with each tick."""

    chair: LiveChair
    held: tuple[float, float] | None = None
    answer: PortAnswer | None = None

    def run(self, seconds: float) -> ChairView:
        loop = self.chair._loop
        for _ in range(round(TICKS * seconds)):
            if self.held is not None:
                self.answer = obey(self.chair, "steer", {"forward": self.held[0], "turn": self.held[1]})
            for _ in range(TICK_NS // BEAT_NS):
                loop._serve()
                loop._beat()
            loop.step()
        return self.chair.view()

    def push(self, forward: float, turn: float = 0.0) -> None:
        self.held = forward, turn

    def let_go(self) -> None:
        self.held = None
        obey(self.chair, "release", {})

    def choose(self, level: HelpLevel) -> None:
        self.chair._chair.choose_level(level)

    @property
    def truth(self) -> Pose2:
        return self.chair.simulator.truth()


@contextmanager
def page_of(**options: HapticOptions) -> Iterator[Page]:
    """Yield the page of a chair in the hall that knows where it is."""
    chair = LiveChair(hall(), countdown_s=0.0, **options)
    with ExitStack() as ends:
        chair._build(ends)
        page = Page(chair)
        page.run(1.0)
        yield page


@pytest.fixture
def page() -> Iterator[Page]:
    with page_of() as made:
        yield made


def test_the_board_holds_the_pages_stick_before_a_wall(page: Page) -> None:
    page.choose(HelpLevel.GUIDE)
    view = page.run(3.0)
    assert view.guard is not None
    assert view.guard.caps is not None
    page.push(0.8)  # less than the board's override
    view = page.run(1.0)
    assert page.answer == PortAnswer(True, "")
    assert view.guard is not None
    assert view.guard.stick[0] == pytest.approx(0.8, abs=0.02)  # on the chair's own joystick, as the board hears it
    assert view.mode is DriveMode.GUARDED
    assert view.twist.v > 0.3
    view = page.run(10.0)
    assert view.guard is not None
    assert view.guard.caps is not None
    assert view.guard.caps[0] < 0.2
    assert view.twist.v < 0.01, "held before the wall, still pushed"
    assert page.truth.x > 4.0  # this chair bends to the side wall
    assert page.chair.simulator.contacts == 0
    page.push(-1.0)
    assert page.run(1.5).twist.v < -0.05, "back is free"


def test_a_push_that_is_held_while_the_guard_begins_counts_after_a_release(page: Page) -> None:
    page.choose(HelpLevel.GUIDE)
    page.push(0.5)
    view = page.run(0.5)
    assert view.guard is not None
    assert view.guard.waits
    assert page.answer == PortAnswer(False, sentence(UNGUARDED))
    view = page.run(4.0)
    assert view.guard is not None
    assert not view.guard.waits
    assert page.truth.x == pytest.approx(2.0, abs=0.01)
    page.let_go()
    page.run(0.1)
    page.push(0.5)
    assert page.run(1.5).twist.v > 0.1


def test_a_push_ends_by_silence_release_stop_and_with_the_guard(page: Page) -> None:
    def falls_silent() -> None:
        page.held = None

    def stops() -> None:
        page.chair._loop.tell(page.chair._page_stick.end)

    def ends_the_guard() -> None:
        page.choose(HelpLevel.INFORM)
        page.held = None

    page.choose(HelpLevel.GUARD)
    page.run(3.0)
    for end in (falls_silent, page.let_go, stops, ends_the_guard):
        page.push(0.5)
        assert page.run(1.2).twist.v > 0.1, end
        end()
        page.run(1.2)
        assert page.chair.simulator.rider.forward == 0.0, end
        assert abs(page.chair.simulator.twist().v) < 0.02, end
        page.let_go()
        page.run(0.1)


def test_at_the_level_inform_the_page_steers_through_the_computer(page: Page) -> None:
    page.push(0.5)
    view = page.run(4.0)
    assert (view.mode, view.steered) == (DriveMode.ASSISTED, True)
    assert page.chair.simulator.rider.forward == 0.0
    assert view.twist.v > 0.1


def test_a_simulated_driver_keeps_the_joystick() -> None:
    driver = HapticOptions(HapticsProfile(speech=False), driver="default")
    with page_of(haptics=driver) as page:
        page.choose(HelpLevel.GUIDE)
        page.run(3.0)
        page.push(0.5)
        page.run(1.0)
        assert page.chair.simulator.rider.forward == 0.0  # nobody leads the driver
