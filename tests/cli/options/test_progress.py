"""Progress where standard error is no terminal."""

import io
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from rich.console import Console

from waychair.cli.options import progress


def told(monkeypatch: pytest.MonkeyPatch, shares: list[tuple[float, float]], quiet: bool = False) -> list[str]:
    """Return the lines about a stage whose share is told at these times [s]."""
    clock = [0.0]
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    text = io.StringIO()
    with progress.stage_bars(Console(file=text, width=200, quiet=quiet)) as show:
        for clock[0], share in shares:
            show("mapping", share)
    return text.getvalue().splitlines()


def test_a_long_stage_tells_its_share_and_the_time_left_each_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = [(0.0, 0.0), (4.0, 0.02), (11.0, 0.05), (12.0, 0.06), (25.0, 0.5), (50.0, 1.0)]
    assert told(monkeypatch, shares) == [
        "mapping: 5 %, about 3 min left",
        "mapping: 50 %, about 25 s left",
        "mapping: 100 %",
    ]


def test_a_short_stage_and_a_quiet_command_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(monkeypatch, [(0.0, 0.0), (5.0, 0.5), (9.0, 1.0)]) == []
    assert told(monkeypatch, [(0.0, 0.0), (60.0, 0.5)], quiet=True) == []


def test_the_time_left_is_not_told_at_the_very_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(monkeypatch, [(0.0, 0.0), (30.0, 0.01)]) == ["mapping: 1 %"]


def test_work_of_unknown_length_tells_the_time_so_far_and_nothing_once_it_is_over(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.01)
    lines, said = "", threading.Event()
    with progress.told_time("solving"):
        while not lines:
            said.wait(0.01)
            lines = capsys.readouterr().err
    assert lines.splitlines()[0] == "solving: 0 s so far"
    capsys.readouterr()
    with progress.told_time("solving", quiet=True):
        said.wait(0.05)
    assert capsys.readouterr().err == ""


def test_a_stage_of_which_nothing_is_heard_is_told_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.01)
    text, said = io.StringIO(), threading.Event()
    with progress.stage_bars(Console(file=text, width=200)) as show:
        show("reading", 1.0)
        show("drive to the desk", 0.0)
        while "drive" not in text.getvalue():
            said.wait(0.01)
        show("drive to the desk", 0.02, "3 m driven")
        while "3 m" not in text.getvalue():
            said.wait(0.01)
    lines = text.getvalue().splitlines()
    assert "drive to the desk: 0 s so far" in lines
    assert lines[-1] == "drive to the desk: 2 %, 3 m driven"


def test_the_time_of_a_stage_counts_from_where_it_begins_and_begins_anew_when_its_share_falls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, text = [0.0], io.StringIO()
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    with progress.stage_bars(Console(file=text, width=200)) as show:
        show("mapping", 0.0)
        for clock[0], stage, share in (
            (1.0, "checking", 0.5),
            (21.0, "checking", 0.9),
            (22.0, "checking", 0.1),
            (33.0, "checking", 0.5),
            (40.0, "mapping", 0.1),
            (60.0, "mapping", 0.5),
        ):
            show(stage, share)
    assert text.getvalue().splitlines() == [
        "checking: 90 %, about 2 s left",
        "checking: 50 %, about 11 s left",
        "mapping: 50 %, about 20 s left",
    ]


def test_on_a_terminal_there_is_a_bar_and_what_a_pipe_gets_stays_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    text = io.StringIO()
    console = Console(file=text, width=200, force_terminal=True)
    with progress.stage_bars(console) as show:
        show("travelling", None, "on storey 2")
        show("mapping", 0.0)
        show("mapping", 1.0)
        print("seed 0: 12 tasks")
    assert capsys.readouterr().out == "seed 0: 12 tasks\n"
    assert "travelling: on storey 2" in text.getvalue()
    assert "100%" in text.getvalue()
    assert "seed 0" not in text.getvalue()


def test_quiet_commands_load_no_library_for_bars() -> None:
    program = (
        "import sys\nfrom waychair.cli.options import progress\nfrom waychair.cli.options.recording_options import stages\n"
        "with progress.told_share('a', True), progress.told_time('b', True), progress.told_stages(True), stages(True):\n"
        "    assert not [name for name in sys.modules if name.startswith('rich')]\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
