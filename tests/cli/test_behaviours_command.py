"""`waychair behaviours show|trace|replay`."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.cli.command import WAYCHAIR, refused, waychair
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.control.behaviours.cell_network import Network
from waychair.control.behaviours.paper import PaperSettings, paper_network
from waychair.control.behaviours.paper_settings import ObstacleLimits
from waychair.control.behaviours.presets import PRESETS, preset_network, shipped
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.sonar import SonarPacket, packet_from_ranges
from waychair.control.behaviours.trace import TraceWriter
from waychair.simulation.plan.world import load_world


def traced(path: Path, settings: PaperSettings | None = None) -> Path:
    """Write a trace of the paper's network: twenty packets that come nearer, and one that is cut short."""
    chosen = settings or PaperSettings()
    wiring = paper_network(chosen, CHAIR_B)
    runtime = Runtime(wiring)
    with TraceWriter(path, wiring, "paper", shipped("paper", chosen, CHAIR_B).values) as trace:
        for k in range(20):
            packet = packet_from_ranges([2.0 - 0.1 * k] * 8) if k != 7 else SonarPacket(b"\xa5\x08")
            heard = {"sonar packet": packet}
            trace.write(runtime.innervate(50_000_000 * k, heard), heard)
    return path


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_a_network_is_shown_with_all_its_cells_and_ports(preset: str) -> None:
    done = waychair("behaviours", "show", preset)
    assert done.returncode == 0, done.stderr
    for name in preset_network(preset, {}).nodes:
        assert name in done.stdout
    assert "EB: door wanted >= 1" in done.stdout


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_every_network_is_drawn_with_its_cells_in_it(preset: str, tmp_path: Path) -> None:
    wiring = preset_network(preset, {})
    done = waychair("behaviours", "show", preset, "--network", "Free-space finding", "-o", tmp_path / "a.svg")
    assert done.returncode == 0, done.stderr
    picture = ElementTree.parse(tmp_path / "a.svg").getroot()
    texts = {element.text for element in picture.iter() if element.tag.endswith("text")}
    node = wiring.nodes["Free-space finding"]
    assert isinstance(node, Network)
    assert {cell.name for cell in node.cells} <= texts


def test_an_unknown_network_and_a_picture_of_another_kind_are_refused(tmp_path: Path) -> None:
    assert "there is no network Doorway: choose among" in refused(
        waychair("behaviours", "show", "--network", "Doorway")
    )
    assert "name a .svg file" in refused(waychair("behaviours", "show", "-o", tmp_path / "a.png"))


def test_a_trace_is_a_table_in_time_with_faults_in_words(tmp_path: Path) -> None:
    path = traced(tmp_path / "a.trace")
    done = waychair("behaviours", "trace", path, "--cell", "decode_packet", "--begin", "0.3", "--end", "0.4")
    assert done.returncode == 0, done.stderr
    assert "0.350" in done.stdout
    assert "cut short" in " ".join(done.stdout.split())
    assert "translate_data" not in done.stdout
    assert "20 innervations of the preset paper" in done.stdout
    assert "--cell sonar is not in the trace" in refused(waychair("behaviours", "trace", path, "--cell", "sonar"))


def test_a_replay_builds_the_network_from_the_trace_and_has_the_same_bytes(tmp_path: Path) -> None:
    settings = PaperSettings(obstacles=ObstacleLimits(immediate=0.6))
    path = traced(tmp_path / "a.trace", settings)
    done = waychair("behaviours", "replay", path, "--out", tmp_path / "b.trace")
    assert done.stdout == "the replay of 20 innervations has the same bytes\n"
    assert (tmp_path / "b.trace").read_bytes() == path.read_bytes()


def test_a_trace_of_another_wiring_and_one_of_no_preset_are_refused(tmp_path: Path) -> None:
    wiring = paper_network(body=CHAIR_B)
    for preset, body in (("paper", CHAIR_A), ("mine", CHAIR_B)):
        with TraceWriter(tmp_path / "a.trace", wiring, preset, shipped("paper", PaperSettings(), body).values) as trace:
            trace.write(Runtime(wiring).innervate(0), {})
        sentence = refused(waychair("behaviours", "replay", tmp_path / "a.trace"))
        assert ("another wiring" if preset == "paper" else "there is no preset 'mine'") in sentence


@pytest.mark.nightly
def test_the_trace_of_a_drive_that_was_killed_is_shown_and_replayed(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    command = ["navigate", "--world", "corridor_t", "--goal", corridor_place(), "--trace", str(path)]
    with subprocess.Popen([WAYCHAIR, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as drive:
        while drive.poll() is None and (not path.exists() or path.stat().st_size < 500_000):
            time.sleep(0.1)
        drive.send_signal(signal.SIGKILL)
    done = waychair("behaviours", "replay", path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("innervations has the same bytes\n")
    table = waychair("behaviours", "trace", path, "--cell", "Way finder", "--most", "5")
    assert "Way finder" in table.stdout
    assert "of the preset default" in table.stdout


def corridor_place() -> str:
    return load_world("corridor_t").places[0].name
