"""The trace of a network: compact, readable after damage, and replayed to the same bytes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from waychair.control.behaviours.cell import Cell, Reading, Sensor, before
from waychair.control.behaviours.cell_network import Network, Wiring, wire
from waychair.control.behaviours.conditions import Active, AtLeast
from waychair.control.behaviours.replay import replay
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.trace import KEY_EVERY, TraceWriter, read_trace, trace_from_bytes
from waychair.errors import OutputError, TraceError
from waychair.types import FloatArray

RUNS, TICK_NS = 3 * KEY_EVERY + 7, 50_000_000


@dataclass(frozen=True)
class Scanned:
    ranges: FloatArray
    label: str = ""


@dataclass(frozen=True)
class Sum:
    total: float = 0.0


def farthest(scan: Scanned) -> float:
    if not len(scan.ranges):
        raise ValueError("the scan is empty")
    return float(scan.ranges.max())


def summed(x: float, dynamic: Sum) -> tuple[float, Sum]:
    return dynamic.total + x, Sum(dynamic.total + x)


def doubled(x: float | None) -> float:
    return 2.0 * (x or 0.0)


def network(limit: float = 0.5) -> Wiring:
    """Return a network with a loop, an inner network, a fault and an effector."""
    cells = [
        Cell("far", farthest, links={"scan": "lidar"}),
        Network(
            "inner",
            [Cell("sum", summed, links={"x": "far"}, dynamic=Sum(), reset_by=AtLeast("far", 0.95))],
            excited_by=AtLeast("far", limit),
            output="sum",
        ),
        Cell("loop", doubled, {"wheel": doubled}, links={"x": before("inner")}, inhibited_by=~Active("inner")),
    ]
    return wire(Network("root", cells), [Sensor("lidar", Scanned)])


def written(path: Path, limit: float = 0.5) -> bytes:
    """Write a trace of RUNS innervations and return its bytes."""
    wiring, rng = network(limit), random.Random(4)
    runtime = Runtime(wiring)
    with TraceWriter(path, wiring) as trace:
        for k in range(RUNS):
            heard: dict[str, object] = {}
            if rng.random() < 0.6:
                scan = Scanned(np.array([rng.random() for _ in range(rng.choice([0] + 9 * [4]))]), "a")
                heard["lidar"] = Reading(scan, TICK_NS * k - 3) if rng.random() < 0.5 else scan
            late = ("sum",) if rng.random() < 0.05 else ()
            trace.write(runtime.innervate(TICK_NS * k, heard, late), heard)
    return path.read_bytes()


def test_a_trace_holds_every_port_of_every_innervation(tmp_path: Path) -> None:
    written(tmp_path / "a.trace")
    trace, again = read_trace(tmp_path / "a.trace"), Runtime(network())
    assert (len(trace.innervations), trace.damaged, trace.gaps) == (RUNS, 0, ())
    for was in trace.innervations:
        heard = {
            name: Reading(
                Scanned(np.frombuffer(value["ranges"][2]), value["label"]), was.stamp_ns if own is None else own
            )
            for name, (value, own) in was.heard.items()
        }
        done = again.innervate(was.stamp_ns, heard, was.late)
        assert (was.ran, was.late, dict(was.actions)) == (done.ran, done.late, dict(done.actions))
        assert dict(was.ports) == dict(done.ports)


def test_a_replay_gives_the_same_bytes(tmp_path: Path) -> None:
    data = written(tmp_path / "a.trace")
    done = replay(read_trace(tmp_path / "a.trace"), network())
    assert done.difference is None
    assert done.innervations == RUNS
    assert done.data == data


def test_a_replay_names_the_first_port_that_differs(tmp_path: Path) -> None:
    written(tmp_path / "a.trace")
    changed = network()
    functions = dict(changed.functions)
    functions["sum"] = (replace(functions["sum"][0], call=lambda x, dynamic: (x + 0.5, dynamic)),)
    difference = replay(read_trace(tmp_path / "a.trace"), replace(changed, functions=functions)).difference
    assert difference is not None
    assert (difference.node, difference.port) == ("inner", "EO")  # the network shows it, and runs before its cell
    assert "EO of inner differs: 0." in str(difference)


def test_a_trace_of_another_wiring_is_refused_and_the_difference_named(tmp_path: Path) -> None:
    written(tmp_path / "a.trace", limit=0.6)
    with pytest.raises(TraceError, match=r"another wiring: 'EB: far >= 0.6' there, 'EB: far >= 0.5' here"):
        replay(read_trace(tmp_path / "a.trace"), network())


def test_every_whole_record_of_a_cut_trace_is_read(tmp_path: Path) -> None:
    data = written(tmp_path / "a.trace")
    whole = trace_from_bytes(data).innervations
    for cut in (len(data) - 1, len(data) // 2, len(data) // 3):
        trace = trace_from_bytes(data[:cut])
        assert trace.innervations == whole[: len(trace.innervations)]
        assert trace.damaged < 2000
        assert not trace.gaps
        assert replay(trace, network()).difference is None


def test_after_damage_reading_goes_on_at_the_next_key_record_and_a_replay_is_refused(tmp_path: Path) -> None:
    data = bytearray(written(tmp_path / "a.trace"))
    whole = trace_from_bytes(bytes(data)).innervations
    data[len(data) // 2] ^= 0x10
    trace = trace_from_bytes(bytes(data))
    assert 0 < RUNS - len(trace.innervations) <= KEY_EVERY
    assert len(trace.gaps) == 1
    assert trace.innervations[trace.gaps[0] :] == whole[-(len(trace.innervations) - trace.gaps[0]) :]
    with pytest.raises(TraceError, match="records are missing before innervation"):
        replay(trace, network())


@pytest.mark.parametrize("data", [b"", b"\0" * 100, b"\xabBN\x01" * 20, os.urandom(400)])
def test_a_file_that_is_no_trace_is_refused_in_one_sentence(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    path.write_bytes(data)
    with pytest.raises(TraceError, match="holds no trace") as refused:
        read_trace(path)
    assert "\n" not in str(refused.value)


def test_a_trace_that_cannot_be_written_or_read_says_so(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        TraceWriter(tmp_path, network())
    with pytest.raises(TraceError, match="cannot read"):
        read_trace(tmp_path / "none.trace")


KILLED = """
import sys
from pathlib import Path
from tests.control.behaviours import test_trace as t
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.trace import TraceWriter
wiring = t.network()
runtime, trace, k = Runtime(wiring), TraceWriter(Path(sys.argv[1]), wiring), 0
while True:
    trace.write(runtime.innervate(k), {})
    k += 1
    if k == 250:
        print("written", flush=True)
"""


def test_a_trace_is_readable_after_a_kill(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[3]
    environment = {**os.environ, "PYTHONPATH": f"{root / 'src'}:{root}"}
    path = tmp_path / "a.trace"
    with subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    assert len(read_trace(path).innervations) >= 250
