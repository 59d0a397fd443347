"""The verdict on a run: is the map right, and do the sentences name the cause?"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from evaluation.corruptions.drawing import Corrupted
from evaluation.corruptions.fault import Part
from evaluation.corruptions.sound_drive import MOUNT, SECOND, START_NS, sound_drive
from evaluation.corruptions.warm_runner import FinishedRun
from waychair.errors import WaychairError
from waychair.geometry import compose
from waychair.recordings.recording import read_tum, read_tum_in_space
from waychair.slam.trajectory_errors import space_errors, truth_errors
from waychair.types import IntArray, Trajectory

GOOD_M, WRONG_M, TIMES = 0.05, 0.3, 3.0
"""RMSE [m] up to which a map is right, and from which it is wrong; and the most of the sound run's time and memory."""
_LEAST_SHARE = 0.8  # of the scans that a whole map holds

_PARTS: dict[Part, str] = {
    "odometry": r"/odom|/robot2/odom|odometry|wheel|encoder",
    "imu": r"/imu|\bIMU\b|gyro|inertial|gravity",
    "lidar": r"/scan|/cloud|\blidar\b|\blaser\b|\bscans?\b|\bbeams?\b|ranges?\b|\bclouds?\b",
    "mount": r"mount|base-from-laser|connect|/tf|upside|laser '",
    "clock": r"stamp|clock|times? of recording|recorded",
    "file": r"file|bag|metadata|damage|\bparts?\b|folder|recording|drive",
    "log": r"line|log|stamp",
    "pictures": r"picture|pair|depth|\blist|camera|associations|stamp",
}
_CONSEQUENCE = r"do not match those before|could not be joined"
"""A sentence that says what the map looks like, and not why."""

_PUT_RIGHT = (
    r"corrected|left out|bridged|converted|(?<!read )(is|are|was|were) (used|sorted|moved|put there|read as)|stands? in"
)
_ACCUSED: dict[Part, str] = {
    "odometry": r"/odom|odometry|wheels?\b",
    "imu": r"/imu|\bIMU\b|\bgyro",
    "lidar": r"/scan|/cloud|\blidar\b|\blaser\b",
}
"""Words by which a sentence accuses a part, by the first of them in it."""


class RunVerdict(StrEnum):
    """What came of a run."""

    MAPS = "maps"
    NAMED = "named"
    UNNAMED = "unnamed"
    """The map is somewhat off, or was refused, or is only a part, and no sentence names the cause."""
    MISBLAMED = "misblamed"
    SILENT_WRONG = "silent wrong"
    TRACEBACK = "traceback"
    TOO_SLOW = "too slow"
    TOO_LARGE = "too large"


@dataclass(frozen=True, slots=True)
class Judged:
    """A run with its verdict; times and memory as multiples of the sound run's. `rmse_m` is nan without a map."""

    seed: int
    fault: str
    kind: int
    verdict: RunVerdict
    rmse_m: float
    share: float
    time_times: float
    memory_times: float
    status: int
    sentences: tuple[str, ...]


def judged(
    made: Corrupted, run: FinishedRun, out: Path, sound: FinishedRun, sound_sentences: tuple[str, ...]
) -> Judged:
    """Return the verdict on a run that wrote its map to `out`, beside the sound recording's run."""
    rmse, share = _error(made, out) if run.status == 0 else (math.nan, 0.0)
    sentences = tuple(sentence for sentence in sentences_of(run.text) if sentence not in sound_sentences)
    times, memory = run.cpu_s / sound.cpu_s, run.memory_mb / sound.memory_mb
    verdict = _verdict(made, run, rmse, share, sentences)
    if verdict is not RunVerdict.TRACEBACK and times > TIMES:
        verdict = RunVerdict.TOO_SLOW
    elif verdict is not RunVerdict.TRACEBACK and memory > TIMES:
        verdict = RunVerdict.TOO_LARGE
    return Judged(
        made.seed, made.fault.name, made.fault.kind, verdict, round(rmse, 4), round(share, 3), round(times, 2),
        round(memory, 2), run.status, sentences,
    )  # fmt: skip


def sentences_of(text: str) -> tuple[str, ...]:
    """Return the warnings and errors of a run's text."""
    lines = re.split(r"[\r\n]+", text)
    return tuple(line for line in lines if re.match(r"\s*(warning|waychair): ", line))


def names(made: Corrupted, sentence: str) -> bool:
    """Return whether a sentence names a part that is at fault, and the kind of the fault."""
    if re.search(_CONSEQUENCE, sentence):
        return False
    part = "|".join(_PARTS[part] for part in made.fault.parts)
    told = re.sub(r"^(\s*\w+: )\S*/seed_\d+\S*", r"\1the file", sentence)  # its subject
    told = re.sub(r"\S*/seed_\d+\S*", "", told)  # the path's own words name nothing
    return bool(re.search(part, told) and re.search(rf"(?<![a-z])(?:{made.fault.words})", told))


def explains(sentence: str, rmse: float) -> bool:
    """Return whether a sentence may explain an error [m]: one that says the fault was put right explains no wrong map."""
    return not rmse > WRONG_M or not re.search(_PUT_RIGHT, sentence)


def accuses_another(made: Corrupted, sentence: str) -> bool:
    """Return whether the first part that a sentence mentions is a sound one."""
    found = [(match.start(), part) for part, words in _ACCUSED.items() if (match := re.search(words, sentence))]
    return bool(found) and min(found)[1] not in made.fault.parts


def _verdict(made: Corrupted, run: FinishedRun, rmse: float, share: float, sentences: tuple[str, ...]) -> RunVerdict:
    crashed = run.status < 0 and -run.status not in (9, 24)  # SIGKILL and SIGXCPU are those of the time's limit
    if "Traceback (most recent call last)" in run.text or crashed or run.status not in (0, 1, -9, -24):
        return RunVerdict.TRACEBACK
    if run.status < 0:
        return RunVerdict.TOO_SLOW
    named = any(names(made, sentence) and explains(sentence, rmse) for sentence in sentences)
    blamed = not named and any(accuses_another(made, sentence) for sentence in sentences)
    right = run.status == 0 and rmse <= GOOD_M and (share >= _LEAST_SHARE or named)
    if right:
        return RunVerdict.MISBLAMED if blamed else RunVerdict.MAPS
    if named:
        return RunVerdict.NAMED
    if run.status == 0 and not rmse <= WRONG_M:
        return RunVerdict.SILENT_WRONG
    return RunVerdict.MISBLAMED if blamed else RunVerdict.UNNAMED


def _error(made: Corrupted, out: Path) -> tuple[float, float]:
    """Return the map's RMSE [m] against the truth, and the share of the sound recording's scans in it."""
    try:
        if made.original == "pictures":
            found = read_tum_in_space(out / "trajectory.tum")
            errors = space_errors(found, read_tum_in_space(out.parent / "groundtruth.tum"))
            return errors.rmse_m, errors.errors.count / max(1, errors.total)
        trajectory = read_tum(out / "trajectory.tum")
    except WaychairError:
        return math.nan, 0.0
    drive = sound_drive()
    scans = len(made.stamps) or len(drive.scan_times)
    base = Trajectory(START_NS + np.rint(drive.times * SECOND).astype(np.int64), drive.truth)
    truth = base
    if made.original == "log":
        truth = Trajectory(base.stamps_ns, compose(base.poses, np.array([*MOUNT, 0.0])))
    best = (math.nan, 0.0)
    for stamps, poses in _timed(made, trajectory):
        try:
            errors_2d = truth_errors(Trajectory(stamps, poses), truth)
        except WaychairError:
            continue
        found_here = (errors_2d.rmse_m, errors_2d.errors.count / scans)
        if math.isnan(best[0]) or (found_here[1] > 0.7 * best[1] and found_here[0] < best[0]):
            best = found_here
    return best


def _timed(made: Corrupted, trajectory: Trajectory) -> list[tuple[IntArray, np.ndarray]]:
    """Return the trajectory with true times in each way in which its stamps may be meant."""
    stamps, poses = trajectory.stamps_ns, trajectory.poses
    ways = [(stamps, poses)]
    drive = sound_drive()
    true = START_NS + np.rint(drive.scan_times * SECOND).astype(np.int64)
    if len(made.stamps):
        back = {int(told): int(measured) for told, measured in made.stamps}
        known = np.array([int(stamp) in back for stamp in stamps], bool)
        ways.append((np.array([back[int(stamp)] for stamp in stamps[known]], np.int64), poses[known]))
        true = made.stamps[:, 1]
    if len(true) == len(stamps):
        ways.append((true, poses))
    if len(true) > 0 and len(stamps) > 1:  # a clock that is set otherwise, but runs as it should
        ways.append((stamps - stamps[0] + true[0], poses))
        ways.append((stamps - stamps[-1] + true[-1], poses))
    return ways
