"""Real recordings, mapped by the command a user types and scored by the metric that stands beside the recordings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from waychair.types import Json

DATA = Path(os.environ.get("WAYCHAIR_DATA", "../shared/data"))


def intel(out: Path) -> Json:
    """Intel Research Lab, first 1088 s: at most 0.10 m mean over its 1030 relations (raw odometry: 3.53 m)."""
    folder = "lidar_intel"
    return _scored(out, f"{folder}/intel_first1088s.clf.gz", f"{folder}/intel_first1088s.relations.gz", 1030, 0.10)


def fr079(out: Path) -> Json:
    """Freiburg 079 with its pseudo-odometry: no bar yet in this issue; measured beside Intel."""
    return _scored(out, "lidar_fr079/fr079_laser.clf.gz", "lidar_fr079/fr079.relations.gz", 1664, 0.10)


def sena(out: Path) -> Json:
    """The robotic wheelchair's loop: closed by at least one loop; its walls are for the eye (map.pgm)."""
    report, _ = _mapped(out, "wheelchair_sena/sena_one_loop.clf.gz")
    return {"passed": report["edges"]["loop"] >= 1, "loops": report["edges"]["loop"], "map": str(_folder(out))}


def _folder(out: Path) -> Path:
    return out.with_suffix("")


def _mapped(out: Path, log: str) -> tuple[Json, float]:
    """The report of `waychair map`, and the processor time of the whole command [s]."""
    command = [
        str(Path(sys.executable).parent / "waychair"),
        "map",
        str(DATA / log),
        "--out",
        str(_folder(out)),
        "--quiet",
    ]
    before = os.times()
    subprocess.run(command, check=True)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return dict(json.loads((_folder(out) / "report.json").read_text())), cpu


def _scored(out: Path, log: str, relations: str, count: int, bar: float) -> Json:
    report, cpu = _mapped(out, log)
    tool = DATA.parent / "tools" / "trajectory_error.py"
    command = [sys.executable, str(tool), "relations", str(_folder(out) / "trajectory.tum"), str(DATA / relations)]
    errors = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return {
        "passed": errors["relations"] == count and errors["trans_mean_m"] <= bar,
        "bar_m": bar,
        **errors,
        "command_cpu_s": round(cpu, 2),
        "peak_memory_mb": report["peak_memory_mb"],
    }
