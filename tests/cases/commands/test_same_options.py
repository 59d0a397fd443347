"""The same option has the same name in every command."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cyclopts import App

from tests.cli.command import waychair
from waychair.cli.main import app

ANSWERS = {"evaluate", "why", "status", "worlds", "places", "report", "config", "doctor", "page", "up"}
"""Commands whose product is the text that they print, and those that serve until they are ended: without --quiet."""


def options_of(parent: App, prefix: str = "") -> Iterator[tuple[str, list[set[str]]]]:
    """Each command with its options, each option with all its names."""
    for name in [name for name in parent if not name.startswith("-")]:
        command = parent[name]
        if any(not inner.startswith("-") for inner in command):
            yield from options_of(command, f"{name} ")
        else:
            yield prefix + name, [set(argument.names) for argument in command.assemble_argument_collection()]


OPTIONS = dict(options_of(app))


def names(command: str) -> set[str]:
    return set().union(*OPTIONS[command]) if OPTIONS[command] else set()


def test_a_command_that_writes_a_file_or_folder_takes_it_by_out_and_o() -> None:
    writing = {
        "map",
        "localize",
        "plan",
        "demo",
        "up",
        "record",
        "save",
        "simulate",
        "vocabulary",
        "export",
        "worlds",
        "why",
    }
    writing |= {name for name in OPTIONS if name.startswith("calibrate ")}
    assert [name for name in sorted(writing) if not {"--out", "-o"} <= names(name)] == []
    for name, options in OPTIONS.items():
        for option in options:
            assert ("--out" in option) == ("-o" in option), f"{name}: {option}"


def test_a_command_that_reports_its_work_can_be_quiet() -> None:
    working = {
        "map",
        "localize",
        "plan",
        "navigate",
        "demo",
        "record",
        "save",
        "barn",
        "simulate",
        "vocabulary",
        "export",
    }
    working |= {name for name in OPTIONS if name.startswith("calibrate ")}
    assert [name for name in sorted(working) if "--quiet" not in names(name)] == []
    assert not working & ANSWERS


def test_a_command_that_maps_localises_plans_or_drives_takes_a_configuration() -> None:
    configured = {
        "map",
        "localize",
        "plan",
        "navigate",
        "demo",
        "page",
        "up",
        "barn",
        "simulate",
        "vocabulary",
        "export",
    }
    assert [name for name in sorted(configured) if "--config" not in names(name)] == []


def test_a_command_that_reads_a_recording_takes_its_topics_mount_and_camera() -> None:
    reading = ("map", "localize", "vocabulary", "export")
    wanted = {"--base-from-laser", "--scan", "--odom", "--imu", "--camera"}
    assert [name for name in reading if not wanted <= names(name)] == []


def test_a_world_and_a_page_have_the_same_names_everywhere() -> None:
    for name in ("page", "up", "navigate", "demo", "simulate"):
        assert {"--world", "--sim"} <= names(name), name
    assert {"--page-port", "--page-lan"} <= names("page") & names("up")


def test_a_map_is_too_large_for_no_command_that_reads_one() -> None:
    assert all("--resolution" in names(name) for name in ("map", "plan", "navigate"))


@pytest.mark.parametrize("option", ["-o", "--out", "--output"])
def test_a_vocabulary_is_written_under_every_name_of_the_option(option: str, tmp_path: Path) -> None:
    done = waychair("vocabulary", tmp_path / "none", option, tmp_path / "words.npz")
    assert "there is no recording" in done.stderr


def test_the_folder_of_a_saved_map_is_given_once() -> None:
    for arguments in ((), ("here", "-o", "there")):
        assert "give the folder of the map once" in waychair("save", *arguments).stderr
