"""Simulated drives with behaviour cells in the tick: their traces, the replays, and the time that the cells take.

Time is that of the thread alone. Other programs still slow it down through the caches, so the network's own time is the
least of several replays of each innervation; the ticks are as they ran.
"""

from __future__ import annotations

import os
import subprocess
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.behaviours.cell_network import Wiring
from waychair.control.behaviours.presets import preset_network
from waychair.control.behaviours.replay import replay, typed_inputs
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.trace import Trace, read_trace
from waychair.control.drive.navigator import Stage
from waychair.runtime.black_box.cell_traces import CellTraceFile
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plan.world import load_world
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, advance_tick, simulated_chair, start_drive
from waychair.types import FloatArray, Goal

WORLDS = ("small_clinic", "apartment", "second_floor", "corridor_t", "glass_door")

WITH_CAMERA = 5
"""One drive in so many has a depth camera: drawing its pictures takes most of the time."""

LEAST_OF = 5
"""Replays of which the least time of an innervation counts."""


@dataclass(frozen=True, slots=True)
class TracedDrive:
    """A drive: time of each tick (T,) [ms], signals that were said, troubles that were named, touches."""

    tick_ms: FloatArray
    signals: tuple[str, ...]
    troubles: tuple[str, ...]
    contacts: int


def drive(seed: int, seconds: float, path: Path | None) -> TracedDrive:
    """Drive to a place of a world for at most some seconds, with the cells' trace in a file, or without cells.

    The rider wants to be led through doorways.
    """
    world = load_world(WORLDS[seed % len(WORLDS)])
    settings = ChairSettings() if path is None else replace(ChairSettings(), perceive=True)
    simulator = Simulator(world, CHAIR_A, _sensors(seed), seed)
    setup = DriveSetup(world.grid, {each.name: each for each in world.places}, CHAIR_A, DEFAULT, chair=settings)
    goal = Goal(world.places[seed // len(WORLDS) % len(world.places)].name)
    tick_ms, signals, troubles = list[float](), dict[str, None](), dict[str, None]()
    with (
        nullcontext() if path is None else CellTraceFile(path) as watcher,
        simulated_chair(setup, simulator, watcher) as chair,
    ):
        chair.want_door(True)
        start_drive(simulator, chair, goal)
        until_ns = simulator.now_ns + round(seconds * 1e9)
        while simulator.now_ns < until_ns:
            messages = advance_tick(simulator, chair)
            begun_s = time.thread_time()
            state = chair.step(simulator.now_ns, messages)
            tick_ms.append(1e3 * (time.thread_time() - begun_s))
            if state.perceived is not None:
                signals[state.perceived.signal] = None
                troubles.update(dict.fromkeys(state.perceived.troubles))
            if state.navigation.stage in (Stage.ARRIVED, Stage.FAILED):
                break
    return TracedDrive(np.array(tick_ms), tuple(signals), tuple(troubles), simulator.contacts)


def _sensors(seed: int) -> SimulatorSettings:
    settings = with_all_sensors(randomised_settings(seed))
    if seed % WITH_CAMERA == 0:
        return settings
    return replace(settings, camera=replace(settings.camera, rate_hz=0.0))


def network_of(trace: Trace) -> Wiring:
    """Return the network of a trace."""
    return preset_network(trace.header.preset, trace.header.settings)


def replays_alike(path: Path) -> bool:
    """Return whether a replay of a trace has the same bytes, as a whole."""
    trace = read_trace(path)
    again = replay(trace, network_of(trace))
    return again.difference is None and again.data == path.read_bytes()


def replays_alike_elsewhere(path: Path, python: str) -> bool:
    """Return whether a replay by another interpreter has the same bytes."""
    code = "from waychair.cli.main import main; main()"
    out = path.with_suffix(".again")
    done = subprocess.run(
        [python, "-c", code, "behaviours", "replay", str(path), "--out", str(out)],
        env={**os.environ, "PYTHONPATH": str(Path("src").resolve())},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode == 0 and out.read_bytes() == path.read_bytes()


def network_ms(trace: Trace) -> FloatArray:
    """Return the time of each innervation (N,) [ms], the least of several replays."""
    wiring = network_of(trace)
    runs = []
    for _ in range(LEAST_OF):
        runtime, times = Runtime(wiring), []
        for each in trace.innervations:
            heard = typed_inputs(wiring, each)
            begun_ns = time.thread_time_ns()
            runtime.innervate(each.stamp_ns, heard, each.late)
            times.append(1e-6 * (time.thread_time_ns() - begun_ns))
        runs.append(times)
    least: FloatArray = np.min(runs, axis=0)
    return least
