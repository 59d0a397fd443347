"""`waychair haptics`: play, check and tune, with a glove in real time on a pseudo-terminal."""

from __future__ import annotations

import io
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from tests.ros.realtime import ALONE
from waychair.control.haptics.patterns import PATTERNS_FILE
from waychair.control.haptics.profile import HapticsProfile, load_profile, save_profile
from waychair.firmware_bridge.glove.program import LiveGlove, glove_program
from waychair.runtime.haptics import bench


@pytest.fixture
def live() -> Iterator[LiveGlove]:
    """A glove that runs by itself, whose levels are fetched."""
    with LiveGlove(glove_program()) as glove:
        done = threading.Event()

        def fetch() -> None:
            while not done.is_set():
                glove.records(0.1)

        thread = threading.Thread(target=fetch)
        thread.start()
        yield glove
        done.set()
        thread.join()


def test_a_symbol_is_shown_as_the_gloves_program_plays_it() -> None:
    done = waychair("haptics", "play", "forward")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "   0 to  150 ms: motor 7 at 76 %",
        " 150 to  300 ms: motor 4 at 76 %",
        " 300 to  450 ms: motor 1 at 76 %",
    ]


def test_the_riders_fitting_and_the_direction_of_an_obstacle_are_used(tmp_path: Path) -> None:
    save_profile(tmp_path / "rider.yaml", HapticsProfile(turned=(1,)))
    done = waychair("haptics", "play", "obstacle_at", "--direction", "90", "--profile", tmp_path / "rider.yaml")
    assert [line.split(": ")[1] for line in done.stdout.splitlines()] == ["motor 6 at 55 %"] * 2


@ALONE
def test_a_symbol_is_played_on_a_live_glove(live: LiveGlove) -> None:
    done = waychair("haptics", "play", "nudge_left", "--port", f"pty:{live.path}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@ALONE
@pytest.mark.parametrize(("times", "told"), [(1, ""), (100, "the glove was lost in the middle of a pattern")])
def test_a_pattern_that_a_busy_computer_stops_is_begun_again(times: int, told: str) -> None:
    with LiveGlove(glove_program()) as glove:
        done = threading.Event()

        def hold_up() -> None:
            left = times
            while not done.is_set():
                if any(any(levels) for _, levels in glove.records(0.1)) and left > 0:
                    left -= 1
                    os.kill(glove.pid, signal.SIGSTOP)
                    time.sleep(0.15)
                    os.kill(glove.pid, signal.SIGCONT)

        thread = threading.Thread(target=hold_up)
        thread.start()
        played = waychair("haptics", "play", "nudge_left", "--port", f"pty:{glove.path}")
        done.set()
        thread.join()
    if told:
        assert told in refused(played)
    else:
        assert (played.returncode, played.stderr) == (0, "")


def test_the_shipped_patterns_pass_the_check() -> None:
    done = waychair("haptics", "check")
    assert done.returncode == 0
    assert "keep all limits of touch" in done.stdout


def test_a_pattern_that_breaks_a_limit_is_told_with_place_and_amount(tmp_path: Path) -> None:
    path = tmp_path / "patterns.yaml"
    path.write_text(
        PATTERNS_FILE.read_text().replace(
            "forward: {sequence: [7, 4, 1], on_ms: 150", "forward: {sequence: [7, 4, 1], on_ms: 250", 1
        )
    )
    done = waychair("haptics", "check", path, "--layout", "glove_3x3")
    assert "1 limits of touch are broken" in refused(done)
    assert "glove_3x3: forward: longest pattern is 600 ms, here 750 ms, that is 150 ms too much" in done.stdout


class Answers(io.StringIO):
    """A rider who takes a while over each answer, longer than a glove that hears nothing keeps its session."""

    def readline(self, size: int = -1, /) -> str:
        """Return the next answer."""
        time.sleep(0.6)
        return super().readline(size)


@ALONE
def test_a_rider_who_takes_time_is_asked_how_the_glove_sits(
    tmp_path: Path, live: LiveGlove, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "PROBE_MS", 20)
    monkeypatch.setattr(bench, "PROBE_REST_MS", 0)
    # The ring begins at the motors 1, 8 and 0 in turn: each answer names the motor 0.
    answers = ["2", "5", "1", "weaker", *["same"] * 9]
    monkeypatch.setattr("sys.stdin", Answers("\n".join(answers) + "\n"))
    done = waychair("haptics", "tune", tmp_path / "rider.yaml", "--port", f"pty:{live.path}")
    assert done.returncode == 0, done.stderr
    fitted = load_profile(tmp_path / "rider.yaml")
    assert fitted.turned == (1,)
    assert fitted.gains == (250, *[200] * 8)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["play", "forwards"], "there is no symbol 'forwards': choose among forward, back"),
        (["play", "obstacle_at", "--direction", "nan"], "--direction is nan: give degrees"),
        (["play", "forward", "--port", "ttyUSB1"], "--port must be /dev/..., pty:/dev/pts/N or tcp:HOST:PORT"),
        (["play", "forward", "--profile", "none.yaml"], "none.yaml"),
        (["check", "none.yaml"], "none.yaml"),
    ],
)
def test_impossible_arguments_are_refused_with_one_sentence(words: list[str], told: str) -> None:
    assert told in refused(waychair("haptics", *words))


@ALONE
def test_answers_that_end_too_soon_leave_no_file(
    tmp_path: Path, live: LiveGlove, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "PROBE_MS", 20)
    monkeypatch.setattr(bench, "PROBE_REST_MS", 0)
    monkeypatch.setattr("sys.stdin", io.StringIO("1\n"))
    done = waychair("haptics", "tune", tmp_path / "rider.yaml", "--port", f"pty:{live.path}")
    assert "the answers ended before the questions" in refused(done)
    assert list(tmp_path.iterdir()) == []
