"""Behaviour cells: the runtime beside a plain interpreter, the paper's rules as a table, free space by the outline."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from evaluation.behaviours.cluttered_places import offered, random_place, truly_free
from evaluation.behaviours.compared_cells import LITERAL_EVERY, differing_ports
from evaluation.behaviours.navigation_table import TableRun, expected, found, list_cases, obstacle_cases
from evaluation.behaviours.traced_drives import drive, network_ms, replays_alike, replays_alike_elsewhere
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.trace import read_trace
from waychair.topics import COMMAND
from waychair.types import Json

NETWORKS, INNERVATIONS = 2000, 500
PLACES = 500
SHARE = 0.95
"""Least part of the truly free orientations that the lidar's view offers."""


DRIVES, DRIVE_S = 20, 15.0
"""Traced drives, and the longest time of each [s]."""

PLAIN_EVERY = 5
"""One drive in so many is also driven without cells, for the tick's time before."""

MEDIAN_MS, P99_MS, TICK_MS = 1.0, 3.0, 15.0
"""Bounds of the network's time in the tick, and of the tick's 99th percentile."""


def behaviours(out: Path) -> Json:
    """2,000 random networks beside the plain interpreter, 20 traced drives replayed byte by byte, and the time in the tick.

    `BEHAVIOURS_NETWORKS`, `BEHAVIOURS_INNERVATIONS`, `BEHAVIOURS_DRIVES` and `BEHAVIOURS_SECONDS` (of a drive) take
    samples. `BEHAVIOURS_PYTHON` names a second interpreter with waychair's dependencies, in which the traces are replayed
    as well.
    """
    compared, drives = _compared_networks(), _traced_drives(out.with_suffix("") / "traces")
    return {**compared, **drives, "passed": compared["passed"] and drives["passed"]}


def _compared_networks() -> Json:
    networks = int(os.environ.get("BEHAVIOURS_NETWORKS", str(NETWORKS)))
    innervations = int(os.environ.get("BEHAVIOURS_INNERVATIONS", str(INNERVATIONS)))
    compared, differing, named = 0, 0, list[str]()
    begun_s = time.process_time()
    for seed in range(networks):
        count, wrong, first = differing_ports(seed, innervations)
        compared, differing, named = compared + count, differing + wrong, (named + first)[:10]
    return {
        "passed": differing == 0 and networks * innervations >= 1,
        "networks": networks,
        "literal_networks": -(-networks // LITERAL_EVERY),
        "innervations": networks * innervations,
        "ports": compared,
        "differing": differing,
        "cpu_s": round(time.process_time() - begun_s, 1),
        "named": named,
    }


def _traced_drives(folder: Path) -> Json:
    count = int(os.environ.get("BEHAVIOURS_DRIVES", str(DRIVES)))
    seconds = float(os.environ.get("BEHAVIOURS_SECONDS", str(DRIVE_S)))
    other = os.environ.get("BEHAVIOURS_PYTHON", "")
    folder.mkdir(parents=True, exist_ok=True)
    drive(0, 1.0, folder / "warm.trace")  # compiles
    alike, alike_elsewhere, contacts, innervations, size = 0, 0, 0, 0, 0
    with_cells, without, network, troubles = list[float](), list[float](), list[float](), dict[str, None]()
    for seed in range(count):
        path = folder / f"{seed}.trace"
        done = drive(seed, seconds, path)
        trace = read_trace(path)
        with_cells += done.tick_ms.tolist()
        network += network_ms(trace).tolist()
        troubles.update(dict.fromkeys(done.troubles))
        alike += replays_alike(path)
        alike_elsewhere += bool(other) and replays_alike_elsewhere(path, other)
        contacts, innervations = contacts + done.contacts, innervations + len(trace.innervations)
        size += path.stat().st_size
        if seed % PLAIN_EVERY == 0:
            without += drive(seed, seconds, None).tick_ms.tolist()
    cells_ms, tick_ms, plain_ms = (_percentiles(each) for each in (network, with_cells, without))
    in_time = cells_ms["median"] <= MEDIAN_MS and cells_ms["p99"] <= P99_MS and tick_ms["p99"] <= TICK_MS
    same = alike == count and (not other or alike_elsewhere == count)
    return {
        "passed": bool(same and in_time),
        "drives": count,
        "replayed_alike": alike,
        "replayed_alike_elsewhere": alike_elsewhere if other else None,
        "drive_innervations": innervations,
        "trace_kb_per_s": round(size / max(innervations, 1) * COMMAND.rate_hz / 1e3, 1),
        "network_ms": cells_ms,
        "tick_ms": tick_ms,
        "tick_without_cells_ms": plain_ms,
        "contacts": contacts,
        "troubles": list(troubles)[:20],
    }


def _percentiles(milliseconds: list[float]) -> dict[str, float]:
    values = np.array(milliseconds or [np.nan])
    return {
        "median": round(float(np.median(values)), 3),
        "p99": round(float(np.percentile(values, 99)), 3),
        "worst": round(float(values.max()), 3),
    }


def paper_rules(out: Path) -> Json:
    """Every combination of the Navigation command manager's inputs, as the table says; `PAPER_RULES_EVERY` samples."""
    every = int(os.environ.get("PAPER_RULES_EVERY", "1"))
    run = TableRun()
    kinds: dict[str, int] = {"warning": 0, "space": 0, "direction": 0}
    wrong, named, count = 0, list[str](), 0
    for cases in (list_cases(), obstacle_cases()):
        for k, case in enumerate(cases):
            if k % every:
                continue
            outcome = found(run.signal(case))
            count += 1
            kinds[outcome[0]] += 1
            if outcome != expected(case):
                wrong += 1
                named = [*named, f"{case}: {outcome} instead of {expected(case)}"][:10]
    return {"passed": wrong == 0, "cases": count, "wrong": wrong, **kinds, "named": named}


def free_space(out: Path) -> Json:
    """500 random cluttered places: no orientation offered that would touch, at least 95 % of the free ones offered.

    `FREE_SPACE_PLACES` takes a sample. "woken" is the lidar of a chair that has not moved: it does not see behind itself.
    """
    places = int(os.environ.get("FREE_SPACE_PLACES", str(PLACES)))
    views = {"lidar": (("lidar",), True), "both": (("lidar", "sonars"), True), "sonars": (("sonars",), True)}
    views["woken"] = (("lidar",), False)
    free_count, touching = 0, dict.fromkeys(views, 0)
    good, named = dict.fromkeys(views, 0), list[str]()
    for seed in range(places):
        place = random_place(seed, CHAIR_A)
        free = truly_free(place, CHAIR_A)
        free_count += int(free.sum())
        for name, (sensors, history) in views.items():
            told = offered(place, CHAIR_A, seed, sensors, history)
            good[name] += int((told & free).sum())
            touching[name] += int((told & ~free).sum())
            if name == "lidar" and (told & ~free).any():
                named = [*named, f"place {seed}: orientations {np.nonzero(told & ~free)[0].tolist()}"][:10]
    shares = {f"{name}_share": round(good[name] / max(free_count, 1), 4) for name in views}
    touches = {f"{name}_touching": touching[name] for name in views}
    passed = touching["lidar"] == 0 and shares["lidar_share"] >= SHARE
    return {"passed": passed, "places": places, "free": free_count, **shares, **touches, "named": named}
