"""Cases of other people's recordings and maps, kept beside the real recordings: each by the command of its README.

The folder `cases/mapping` beside that of `WAYCHAIR_DATA` holds a folder for each case; nothing of it is in this repository.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from evaluation.figures.mapping.logs import DATA
from waychair.types import Json

_RIGHT_M = 0.05
_CAMERA_M = 0.015
_PICTURES = "rgbd_tum_fr1_rpy_head"
_LIMIT_S = 900.0


@dataclass(frozen=True, slots=True)
class CaseRow:
    """A case: its kind's number, what happened before (by its README), what was measured now, and whether it is right."""

    case: str
    kind: int
    before: str
    after: str
    right: bool


def cases(out: Path) -> Json:
    """Every case does as its README expects; `CASES=imu` takes those whose name contains the text.

    Skipped, with a reason, where the folder of cases is missing: it lies beside that of `WAYCHAIR_DATA`.
    """
    folder, named = DATA.parent / "cases" / "mapping", os.environ.get("CASES", "")
    if not folder.is_dir():
        return {"passed": True, "skipped": f"there is no folder {folder} beside that of WAYCHAIR_DATA"}
    rows = []
    for path in sorted(path for path in folder.iterdir() if path.is_dir() and named in path.name):
        kind, before, check = _CHECKS.get(path.name, (0, "", _unknown))
        with tempfile.TemporaryDirectory() as work:
            after, right = check(path, Path(work))
        rows.append(CaseRow(path.name, kind, before, after, right))
        print(f"{path.name:36} {kind:2}  {before:60.60}  {after:80.80}  {'right' if right else 'WRONG'}", flush=True)
    return {
        "passed": all(row.right for row in rows),
        "cases": len(rows),
        "right": sum(row.right for row in rows),
        "rows": [asdict(row) for row in rows],
    }


Check = Callable[[Path, Path], tuple[str, bool]]


def _waychair(*arguments: str | Path) -> tuple[int, str]:
    command = [str(Path(sys.executable).parent / "waychair"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    text = re.sub(r"\s+", " ", done.stderr + done.stdout)
    return done.returncode, "Traceback" if "Traceback" in text else text.strip()


def _rmse(trajectory: Path, truth: Path) -> float:
    _, said = _waychair("evaluate", trajectory, "--truth", truth)
    found = re.search(r"RMSE ([\d.]+) m", said)
    return float(found[1]) if found else float("inf")


def _mapped(words: str = "", truth: str = "") -> Check:
    """Return the check of a bag that must map within 5 cm of its truth, with a sentence of these words."""

    def check(path: Path, work: Path) -> tuple[str, bool]:
        status, said = _waychair("map", path / "bag", "--out", work / "map")
        if status:
            return said, False
        error = _rmse(work / "map" / "trajectory.tum", path / f"{truth or path.name}.truth.tum")
        return f"{error:.3f} m; {_warnings(said)}", error <= _RIGHT_M and re.search(words, said) is not None

    return check


def _warnings(said: str) -> str:
    found = re.findall(r"warning: (.*?)(?= warning: |\d+ scans over|$)", said)
    return "; ".join(found) or "no warning"


def _camera(path: Path, work: Path) -> tuple[str, bool]:
    error = _rmse(path / "trajectory.tum", path / "truth.tum")
    return f"{error:.4f} m in space", error <= _CAMERA_M


def _flat_cloud(path: Path, work: Path) -> tuple[str, bool]:
    status, said = _waychair("map", path / "bag", "--out", work / "map")
    return said, status == 0 and "mount" in said


def _with_pictures(check: Callable[[Path, Path], tuple[str, bool]], name: str) -> Check:
    """Return the check of a folder of pictures that the case's own program makes."""

    def made(path: Path, work: Path) -> tuple[str, bool]:
        if not (DATA / _PICTURES).is_dir():
            return f"skipped: there is no {_PICTURES}", True
        subprocess.run([sys.executable, str(path / "make.py"), str(DATA), str(work)], check=True, capture_output=True)
        return check(work / name, work)

    return made


def _scaled(path: Path, work: Path) -> tuple[str, bool]:
    _, doubted = _waychair("map", path, "--out", work / "doubted", "--camera", "fr1")
    _waychair("map", path, "--out", work / "map", "--camera", "fr1", "--depth-scale", "1000")
    error = _rmse(work / "map" / "trajectory.tum", DATA / _PICTURES / "groundtruth.txt")
    return f"{error:.3f} m with --depth-scale 1000; {_warnings(doubted)}", error <= _RIGHT_M and "depth" in doubted


def _stamped(path: Path, work: Path) -> tuple[str, bool]:
    status, said = _waychair("map", path, "--out", work / "map", "--camera", "fr1")
    error = (
        _rmse(work / "map" / "trajectory.tum", DATA / _PICTURES / "groundtruth.txt") if status == 0 else float("inf")
    )
    return f"{error:.3f} m; {_warnings(said)}" if status == 0 else said, error <= _RIGHT_M


def _large(path: Path, work: Path) -> tuple[str, bool]:
    maker = [sys.executable, str(path.parent / "make_bags.py"), str(work), path.name]
    subprocess.run(maker, check=True, capture_output=True)
    _, said = _waychair("map", work / path.name, "--out", work / "map")
    status, planned = _waychair("plan", "--map", work / "map", "--start", "1,0", "--goal", "100,0")
    return f"{_warnings(said)}; plan: {planned}", status == 0


def _thresholds(path: Path, work: Path) -> tuple[str, bool]:
    _, said = _waychair("plan", "--map", path / "map.yaml", "--start", "2.2,9", "--goal", "10.7,9")
    lengths = [float(number) for number in re.findall(r"([\d.]+) m\b", said)]
    return said, any(18.0 <= length <= 23.0 for length in lengths) and "unknown" in said


def _database(path: Path, work: Path) -> tuple[str, bool]:
    status, said = _waychair("map", path / "map.db", "--out", work / "map")
    return said, status == 1 and "RTAB-Map" in said


def _two_robots(path: Path, work: Path) -> tuple[str, bool]:
    status, said = _waychair("map", path / "bag", "--out", work / "map")
    if status:
        return said, "--scan" in said and "robot1" in said and "robot2" in said
    errors = [_rmse(work / "map" / "trajectory.tum", path / f"{path.name}.robot{k}.truth.tum") for k in (1, 2)]
    return f"{min(errors):.3f} m; {_warnings(said)}", min(errors) <= _RIGHT_M


def _degrees(path: Path, work: Path) -> tuple[str, bool]:
    source = path.parent / "map_yaml_free_thresh_025"
    for name in ("map.yaml", "map.pgm"):
        shutil.copyfile(source / name, work / name)
    refused, said = _waychair("places", "--map", work, "--add", "kitchen", "2.2,9,90")
    taken, also = _waychair("places", "--map", work, "--add", "kitchen", "2.2,9,90deg")
    return f"{said}; 90deg: {also}", refused != 0 and "90deg" in said and taken == 0


def _unknown(path: Path, work: Path) -> tuple[str, bool]:
    return "no check is known for this case", False


_CHECKS: dict[str, tuple[int, str, Check]] = {
    "camera_trajectory_evaluated": (5, "RMSE 0.038 m: flattened to x, y and yaw", _camera),
    "cloud_without_heights": (2, "none of the 157 scans holds a distance: check the laser", _flat_cloud),
    "depth_pictures_of_another_scale": (5, "a fifth of its size, without a word", _with_pictures(_scaled, "fr1_millimetres")),
    "imu_in_degrees": (1, "11.0 m; is the wheels' radius right?", _mapped(r"/imu/data.*57|degrees a second")),
    "lidar_nothing_is_range_max": (2, "6.6 m; is the wheels' radius right?", _mapped("/scan.*nothing")),
    "lidar_of_240_degrees": (2, "0.78 m; torn beside a near cupboard", _mapped()),
    "lidar_time_increment_in_ns": (2, "a traceback: ZeroDivisionError", _mapped("time_increment")),
    "map_larger_than_can_be_read": (3, "plan refuses the map that map made", _large),
    "map_yaml_free_thresh_025": (3, "8.5 m through two glass fronts, silently", _thresholds),
    "odometry_begins_anew": (1, "13.6 m; the place was found again", _mapped("/odom.*(restart|begin|anew|zero)")),
    "odometry_one_wild_message": (1, "223 s, 4.7 GB, no map", _mapped("/odom.*left out")),
    "rtabmap_database": (4, "a damaged bag; repair it", _database),
    "split_ros1_bags": (4, "the folder is no recording", _mapped()),
    "tum_stamps_in_scientific_notation": (5, "55 of 60 pairs left out, exit 0", _with_pictures(_stamped, "fr1_savetxt")),
    "two_robots_in_a_bag": (1, "1.3 m; one robot's scans with the other's odometry", _two_robots),
    "yaw_in_degrees": (7, "stored as 117 degrees, without a word", _degrees),
}  # fmt: skip
