"""The level of help that a rider chose last: kept in the rider's file, offered, and begun by the rider alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.haptics.profile import HapticsProfile, load_profile, save_profile
from waychair.control.safety.guard import SPOKEN
from waychair.errors import ConfigError, TransportError
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.runtime.chair import Chair
from waychair.runtime.drive_base import DriveBase
from waychair.runtime.pages.chair_port import PortAnswer
from waychair.runtime.pages.guard_port import GuardPort
from waychair.runtime.rider.guard_view import GuardView, guard_view
from waychair.runtime.rider.kept_level import KeptLevel
from waychair.types import GuardReport, HelpLevel, JoystickInput, Pose2, Telemetry


def test_a_chosen_level_is_kept_beside_the_rest_of_the_riders_file(tmp_path: Path) -> None:
    path = tmp_path / "rider.yaml"
    save_profile(path, HapticsProfile(layout="belt_8", hand="none", rate=220))
    kept = KeptLevel(path)
    assert kept.level() is HelpLevel.INFORM
    assert kept.keep(HelpLevel.GUIDE) == ""
    assert KeptLevel(path).level() is HelpLevel.GUIDE
    assert load_profile(path) == HapticsProfile(layout="belt_8", hand="none", rate=220, level="guide")


def test_without_a_file_nothing_is_kept_and_a_new_file_is_made_by_the_first_choice(tmp_path: Path) -> None:
    assert KeptLevel().keep(HelpLevel.GUARD) == ""
    assert KeptLevel().level() is HelpLevel.INFORM
    path = tmp_path / "new.yaml"
    assert KeptLevel(path).level() is HelpLevel.INFORM
    assert not path.exists()
    assert KeptLevel(path).keep(HelpLevel.GUARD) == ""
    assert KeptLevel(path).level() is HelpLevel.GUARD


def test_a_level_that_cannot_be_kept_is_told_and_an_impossible_one_refused(tmp_path: Path) -> None:
    folder = tmp_path / "rider.yaml"
    folder.mkdir()
    assert KeptLevel(folder).keep(HelpLevel.GUARD).startswith("It is not kept for the next time: ")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("level: push\n")
    with pytest.raises(ConfigError, match=r"level = 'push'.*inform, guard, guide"):
        KeptLevel(wrong).level()


def test_the_last_level_is_offered_and_does_not_begin_by_itself() -> None:
    base = DriveBase(ChairCalibration("A", "2026-11-26"), Reconnecting(_no_cable), Pose2())
    base.guard.offer(HelpLevel.GUIDE)
    assert (base.guard.level, base.guard.wanted) == (HelpLevel.INFORM, False)
    assert base.guard.told == "Last time you chose guide. Choose it again to begin."
    shown = guard_view(base.guard, None)
    assert shown == GuardView(told=base.guard.told, offered=HelpLevel.GUIDE)
    assert not shown.waits
    base.guard.offer(HelpLevel.INFORM)  # nothing to say
    assert base.guard.told == shown.told


def test_a_page_is_shown_the_boards_caps_and_that_it_waits_for_a_stick_at_rest() -> None:
    report = GuardReport((0.1, 0.2, 0.3, 0.4), capped=True, lost=True)
    telemetry = Telemetry(0, 1.65, 1.65, JoystickInput(0), guard=report)

    class Help:
        level, told, offered, overridden = HelpLevel.GUARD, SPOKEN[HelpLevel.GUARD], HelpLevel.GUARD, True
        own_caps = (1.0, 0.0, 0.3, 0.4)

    assert guard_view(Help(), None).waits
    shown = guard_view(Help(), telemetry)
    assert (shown.caps, shown.capped, shown.lost, shown.creeps, shown.waits) == (report.caps, True, True, True, False)
    assert shown.own_caps == Help.own_caps


class _Port(GuardPort):
    """A port whose chair takes a level, or does not."""

    def __init__(self, chair: Chair, path: Path) -> None:
        self._chair, self._kept_level = chair, KeptLevel(path)

    def _request(self, what: Callable[[], PortAnswer], first: bool = False) -> PortAnswer:
        return what()

    def _guarded(self) -> tuple[Chair, int]:
        return self._chair, 0


class _Chair(Chair):
    """The level of a chair without its map and sensors."""

    def __init__(self) -> None:
        self._base = DriveBase(ChairCalibration("A", "2026-11-26"), Reconnecting(_no_cable), Pose2())
        self._watcher = None


def test_a_level_that_the_chair_does_not_take_is_not_kept(tmp_path: Path) -> None:
    path = tmp_path / "rider.yaml"
    port = _Port(_Chair(), path)
    answer = port.choose_level(HelpLevel.GUARD)  # its joystick was never measured
    assert not answer.done
    assert "calibrate" in answer.sentence
    assert not path.exists()
    assert port.choose_level(HelpLevel.INFORM) == PortAnswer(True, SPOKEN[HelpLevel.INFORM])
    assert not port.override_guard().done


def _no_cable() -> Transport:
    raise TransportError("no board is here")
