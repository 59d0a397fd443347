"""Many recordings at once: how much faster than one by one, with the same maps, and after kills of every part."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from waychair.types import Json

RECORDINGS = (
    "lidar_coreslam/exp1.dat.gz",
    "lidar_coreslam/exp2.dat.gz",
    "lidar_fr079/fr079_laser.clf.gz",
    "lidar_intel/intel_first1088s.clf.gz",
    "lidar_radish_corrected/aces-corrected.log.gz",
    "lidar_radish_corrected/freiburg-101-corrected.log.gz",
    "lidar_radish_corrected/freiburg-campus-corrected.log.gz",
    "lidar_radish_corrected/infinite-corridor-corrected.log.gz",
    "lidar_radish_corrected/seattle-corrected.log.gz",
    "ros_bags/husky_imu_odom_gps.bag",
    "ros_bags/nav2_turtlebot.mcap",
    "wheelchair_sena/sena_one_loop.clf.gz",
    "rgbd_tsdf_sample50",
    "rgbd_tum_fr1_rpy_head",
)
LEAST_SPEEDUP = 1.7
KILLS = 20
_JOBS = 2
_UNLIKE = {"report.json", "report.html", "map_all.json", "memory.db"}
"""Files with times, and a database whose pages depend on when they were written."""


def map_all(out: Path) -> Json:
    """The recordings on two cores >= 1.7 times as fast as one by one, by processes and by Dask; three bad ones are named.

    Then the command is killed with -9 20 times, itself, a mapping process, a worker or the scheduler, and run again until
    it ends: the maps are those of one by one. `MAP_ALL_RECORDINGS=exp1,sena` takes a sample by parts of names,
    `MAP_ALL_KILLS=4` fewer kills.
    """
    folder = out.with_suffix("")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    wanted = os.environ.get("MAP_ALL_RECORDINGS", "").split(",")
    good = [DATA / name for name in RECORDINGS if any(part in name for part in wanted)]
    kills = int(os.environ.get("MAP_ALL_KILLS", str(KILLS)))
    bad = _bad_recordings(folder / "bad")
    alone, hashes, mappable = _one_by_one(good, folder / "alone")
    pool_s, pool = _timed([*good, *bad], folder / "pool", "--jobs", str(_JOBS))
    with _cluster(folder) as cluster:
        dask_s, dask = _timed([*good, *bad], folder / "dask", "--cluster", cluster.address)
    named = all(_is_named(report, path.name.split(".")[0]) for report in (pool, dask) for path in bad)
    same = all(_hashes(folder / where, mappable) == hashes for where in ("pool", "dask"))
    killed = _killed(good, folder, kills, alone / _JOBS, hashes, mappable)
    speedups = {"pool": round(alone / pool_s, 2), "dask": round(alone / dask_s, 2)}
    return {
        "passed": min(speedups.values()) >= LEAST_SPEEDUP and named and same and killed["same"] and wanted == [""],
        "recordings": len(good),
        "one_by_one_s": round(alone, 1),
        "pool_s": round(pool_s, 1),
        "dask_s": round(dask_s, 1),
        **{f"{name}_times_as_fast": value for name, value in speedups.items()},
        "bad_named": named,
        "same_hashes": same,
        "peak_memory_mb": pool["peak_memory_mb"],
        "kills": killed,
        "rows": pool["recordings"],
    }


def _bad_recordings(folder: Path) -> list[Path]:
    """Return a broken, an empty and a vanished recording."""
    folder.mkdir()
    (folder / "broken.log").write_bytes(np.random.default_rng(0).bytes(4000))
    (folder / "empty.bag").touch()
    return [folder / "broken.log", folder / "empty.bag", folder / "vanished.mcap"]


def _program(*words: str) -> list[str]:
    return [sys.executable, "-c", "from waychair.cli.main import main; main()", *words]


def _one_by_one(recordings: Sequence[Path], out: Path) -> tuple[float, dict[str, str], list[str]]:
    """Map the recordings by `waychair map`; return the seconds, the hashes, and the names of those with a map."""
    from waychair.offline.many.bags import named_bags

    began, mapped = time.monotonic(), []
    for bag in named_bags(recordings)[0]:
        run = subprocess.run(_program("map", str(bag.path), "--out", str(out / bag.name), "--quiet"), check=False)
        if run.returncode == 0:
            mapped.append(bag.name)
    return time.monotonic() - began, _hashes(out, mapped), mapped


def _timed(recordings: Sequence[Path], out: Path, *options: str) -> tuple[float, Json]:
    """Run the command; return the seconds and its report."""
    began = time.monotonic()
    subprocess.run(_program("map-all", *map(str, recordings), "--out", str(out), *options), check=False)
    return time.monotonic() - began, json.loads((out / "report.json").read_text())


def _hashes(out: Path, names: Sequence[str]) -> dict[str, str]:
    """Return the hash of each file of the maps that does not hold times."""
    files = [path for name in names for path in sorted((out / name).glob("*")) if path.name not in _UNLIKE]
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _is_named(report: Json, name: str) -> bool:
    return any(row["name"] == name and row["state"] == "failed" and row["why"] for row in report["recordings"])


class _Cluster:
    """A scheduler and two workers of this computer, of which each can be killed and started again."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        import socket

        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self._folder, self._stack = folder, stack
        self.scheduler = self._scheduler()
        self.workers = [self._worker() for _ in range(_JOBS)]

    def _started(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments, "--no-dashboard"]
        with (self._folder / "cluster.log").open("a") as log:
            process = subprocess.Popen(command, stderr=log, stdout=log)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def _scheduler(self) -> subprocess.Popen[bytes]:
        return self._started("dask_scheduler", "--host", "127.0.0.1", "--port", self.address.rpartition(":")[2])

    def _worker(self) -> subprocess.Popen[bytes]:
        scratch = str(self._folder / "scratch")
        return self._started("dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--local-directory", scratch)

    def mend(self) -> None:
        """Start the dead parts again."""
        if self.scheduler.poll() is not None:
            self.scheduler = self._scheduler()
        self.workers = [each if each.poll() is None else self._worker() for each in self.workers]


@contextmanager
def _cluster(folder: Path) -> Iterator[_Cluster]:
    with ExitStack() as stack:
        yield _Cluster(folder, stack)


def _killed(
    recordings: Sequence[Path], folder: Path, kills: int, about_s: float, hashes: dict[str, str], names: Sequence[str]
) -> Json:
    """Kill the command or a part of it at seeded moments, and run it again until it ends by itself.

    Every fourth kill is of the command, a mapping process, a worker and the scheduler; for the last two the workers of a
    cluster map. The whole is begun anew when all is mapped before the kills are used up.
    """
    rng = np.random.default_rng(38)
    rounds, used = 0, 0
    unlike: set[str] = set()
    with _cluster(folder) as cluster:
        while used < kills:
            out, rounds, ended = folder / f"killed_{rounds}", rounds + 1, False
            while not ended:
                victim = ("itself", "process", "worker", "scheduler")[used % 4] if used < kills else "nobody"
                cluster.mend()
                options = ["--jobs", str(_JOBS)] if victim in ("itself", "process") else ["--cluster", cluster.address]
                command = _program("map-all", *map(str, recordings), "--out", str(out), "--quiet", *options)
                with subprocess.Popen(command, stderr=subprocess.DEVNULL) as run:
                    if victim != "nobody":
                        used += _kill(victim, run, cluster, float(rng.uniform(4.0, 4.0 + about_s / 3)))
                    run.wait()
                ended = run.returncode in (0, 1) and _is_complete(out)
            found = _hashes(out, names)
            differing = {f"{out.name}/{path}" for path in hashes | found if hashes.get(path) != found.get(path)}
            unlike |= differing
            if not differing:  # else it stays, to be looked into
                shutil.rmtree(out)
    return {"kills": used, "rounds": rounds, "same": not unlike, "unlike": sorted(unlike)}


def _is_complete(out: Path) -> bool:
    """Return whether the command has mapped each recording, or found that it cannot be mapped."""
    report = out / "report.json"
    return report.exists() and all(
        row["state"] in ("done", "failed") for row in json.loads(report.read_text())["recordings"]
    )


def _kill(victim: str, run: subprocess.Popen[bytes], cluster: _Cluster, after_s: float) -> bool:
    """Kill a part after some seconds; return whether it was still there."""
    try:
        run.wait(after_s)
        return False
    except subprocess.TimeoutExpired:
        pass
    if victim == "process":
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        pids = [pid for task in children.parent.parent.glob("*/children") for pid in task.read_text().split()]
        if not pids:
            return False
        os.kill(int(pids[0]), signal.SIGKILL)
        return True
    {"itself": run, "worker": cluster.workers[0], "scheduler": cluster.scheduler}[victim].kill()
    return True
