"""A joystick of this computer: events as Linux's joystick interface writes them, through a named pipe in place of the device."""

from __future__ import annotations

import logging
import os
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import JoystickError
from waychair.simulation.plan.world import load_world
from waychair.simulation.simulator import Simulator
from waychair.trials.live.computer_joystick import AGAIN_NS, ComputerJoystick, SteersByComputer
from waychair.trials.live.live_chair import LiveChair

AXIS, BUTTON, AT_BEGINNING = 2, 1, 0x80


@dataclass
class Plug:
    """The end of the pipe at which the kernel writes."""

    path: Path
    end: int | None = None

    def plug_in(self) -> None:
        self.end = os.open(self.path, os.O_RDWR | os.O_NONBLOCK)

    def unplug(self) -> None:
        if self.end is not None:
            os.close(self.end)
            self.end = None

    def write(self, value: int, kind: int, number: int) -> None:
        assert self.end is not None
        os.write(self.end, struct.pack("<IhBB", 0, value, kind, number))


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    path = tmp_path / "js0"
    os.mkfifo(path)
    plug = Plug(path)
    plug.plug_in()
    yield plug
    plug.unplug()


def test_ahead_and_left_are_positive_and_only_the_first_two_axes_count(plug: Plug) -> None:
    stick = ComputerJoystick(plug.path)
    plug.write(0, AXIS | AT_BEGINNING, 0)
    plug.write(-32768, AXIS, 1)
    plug.write(-16384, AXIS, 0)
    plug.write(32767, AXIS, 3)
    plug.write(1, BUTTON, 1)
    read = stick.read(7)
    assert (read.stamp_ns, read.forward) == (7, 1.0)
    assert read.turn == pytest.approx(0.5, abs=1e-3)
    assert stick.read(8).forward == 1.0, "an axis stays where it is until the next event"
    plug.write(900, AXIS, 1)
    plug.write(-1500, AXIS, 0)
    assert (stick.read(9).forward, stick.read(9).turn) == (0.0, 0.0), "what does not quite come back to zero is at rest"
    stick.close()


def test_a_joystick_that_is_not_there_or_was_unplugged_is_named(plug: Plug) -> None:
    with pytest.raises(JoystickError, match=r"js7 cannot be opened \(No such file or directory\): name one of"):
        ComputerJoystick(plug.path.parent / "js7")
    stick = ComputerJoystick(plug.path)
    plug.unplug()
    with pytest.raises(JoystickError, match="plug it in again"):
        stick.read(0)
    stick.close()


def test_an_unplugged_joystick_is_at_rest_with_one_warning_and_is_taken_up_when_it_is_back(
    plug: Plug, caplog: pytest.LogCaptureFixture
) -> None:
    simulator = Simulator(load_world("apartment"), CHAIR_A)
    steers = SteersByComputer(plug.path)
    plug.write(-20000, AXIS, 1)
    steers.beat(simulator)
    assert simulator.rider.forward == pytest.approx(0.61, abs=0.01)
    plug.unplug()
    away = plug.path.rename(plug.path.with_name("away"))
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            steers.beat(simulator)
            assert simulator.rider.forward == 0.0
            simulator.advance(AGAIN_NS)
    assert len(caplog.records) == 1
    away.rename(plug.path)
    plug.plug_in()
    steers.beat(simulator)
    plug.write(16384, AXIS, 1)
    steers.beat(simulator)
    assert simulator.rider.forward == pytest.approx(-0.5, abs=1e-3)
    steers.close()


def test_a_person_drives_the_simulated_chair_of_a_page_by_the_joystick_of_this_computer(plug: Plug) -> None:
    with LiveChair("apartment", people=False, stick=plug.path) as chair:
        start = chair.simulator.truth()
        plug.write(-20000, AXIS, 1)
        ends = time.monotonic() + 60.0
        while (start.inverse() @ chair.simulator.truth()).x < 0.1:
            assert time.monotonic() < ends
            time.sleep(0.02)
        plug.unplug()
        while abs(chair.simulator.twist().v) > 0.01:
            assert time.monotonic() < ends
            time.sleep(0.02)


def test_a_page_without_the_joystick_that_it_names_says_so(tmp_path: Path) -> None:
    with pytest.raises(JoystickError, match="js3"), LiveChair("apartment", stick=tmp_path / "js3"):
        pass
