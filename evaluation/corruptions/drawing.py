"""The corrupted recording of a seed: the fault, what it is done to, and the files."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from evaluation.corruptions.fault import RecordingFault
from evaluation.corruptions.file_faults import FILE_FAULTS
from evaluation.corruptions.imu_faults import IMU_FAULTS
from evaluation.corruptions.lidar_faults import LIDAR_FAULTS
from evaluation.corruptions.log_faults import LOG_FAULTS, write_log
from evaluation.corruptions.messages import ODOM, SCAN, Messages, Storage, sound_messages, stamp_of, write_messages
from evaluation.corruptions.odometry_faults import ODOMETRY_FAULTS
from evaluation.corruptions.picture_faults import PICTURE_FAULTS, write_pictures
from waychair.types import IntArray

FAULTS = (*ODOMETRY_FAULTS, *IMU_FAULTS, *LIDAR_FAULTS, *FILE_FAULTS, *LOG_FAULTS, *PICTURE_FAULTS)
_ORDER = 34  # seed of the order in which seeds get their faults
_STORAGE_SHARES = (0.5, 0.25, 0.25)  # mcap, db3, ROS 1
_PICTURES = "rgbd_tum_fr1_rpy_head"

SOUND = ("bag.mcap", "bag.db3", "bag.bag", "cloud.mcap", "log", "pictures")
"""The sound recordings, of which one is the original of each corrupted one."""


@dataclass(frozen=True, slots=True)
class Corrupted:
    """A corrupted recording: the path to be mapped, and the sound recording that it was.

    `stamps` (N, 2) [ns] are the stamps of its scans and the times at which they were measured; empty for other files.
    """

    seed: int
    fault: RecordingFault
    path: Path
    original: str
    stamps: IntArray


def faults(pictures: Path | None) -> tuple[RecordingFault, ...]:
    """Return the faults that can be made, those of pictures only where there is a folder of them."""
    return tuple(fault for fault in FAULTS if pictures is not None or fault.where != "pictures")


def pictures_in(data: Path) -> Path | None:
    """Return the folder of pictures in the folder of real recordings, None where it is missing."""
    folder = data / _PICTURES
    return folder if (folder / "associations.txt").exists() else None


def fault_of(seed: int, pictures: Path | None) -> RecordingFault:
    """Return the fault of a seed; as many seeds as there are faults take each once."""
    known = faults(pictures)
    turn, place = divmod(seed, len(known))
    return known[int(np.random.default_rng((_ORDER, turn)).permutation(len(known))[place])]


def corrupted(seed: int, fault: RecordingFault, folder: Path, pictures: Path | None) -> Corrupted:
    """Write the recording of a seed with a fault into an empty folder, and return it."""
    rng = np.random.default_rng((seed, _number(fault)))
    if fault.where == "pictures":
        assert pictures is not None
        path = folder / "fr1"
        write_pictures(pictures, path)
        return _changed(seed, fault, path, "pictures", rng)
    if fault.where == "log":
        path = folder / "drive.log"
        write_log(path)
        return _changed(seed, fault, path, "log", rng)
    storage: Storage = "mcap"
    if fault.where != "clouds":
        storage = ("mcap", "db3", "bag")[int(rng.choice(3, p=_STORAGE_SHARES))]
    path = folder / ("drive.bag" if storage == "bag" else "drive")
    if fault.where == "file":
        shutil.copytree(_sound_bag(storage), path) if storage != "bag" else shutil.copyfile(_sound_bag(storage), path)
        return _changed(seed, fault, path, f"bag.{storage}", rng)
    messages = sound_messages(1 if storage == "bag" else 2, clouds=fault.where == "clouds")
    assert fault.messages is not None
    fault.messages(messages, rng)
    write_messages(path, messages, storage)
    original = "cloud.mcap" if fault.where == "clouds" else f"bag.{storage}"
    return Corrupted(seed, fault, path, original, _stamps(messages))


def sound(name: str, folder: Path, pictures: Path | None) -> Path:
    """Write a sound recording into an empty folder and return its path."""
    if name == "pictures":
        assert pictures is not None
        write_pictures(pictures, folder / "fr1")
        return folder / "fr1"
    if name == "log":
        write_log(folder / "drive.log")
        return folder / "drive.log"
    storage: Storage = next(storage for storage in ("mcap", "db3", "bag") if name.endswith(storage))
    path = folder / ("drive.bag" if storage == "bag" else "drive")
    write_messages(path, sound_messages(1 if storage == "bag" else 2, clouds=name.startswith("cloud")), storage)
    return path


def torn(path: Path) -> Path:
    """Write a drive without odometry in whose middle scans are missing, so that the mapper has to find its place again."""
    messages = sound_messages(2)
    messages.remove(messages.of(ODOM) + messages.of(SCAN)[50:75])
    write_messages(path, messages, "mcap")
    return path


def _changed(seed: int, fault: RecordingFault, path: Path, original: str, rng: np.random.Generator) -> Corrupted:
    assert fault.file is not None
    return Corrupted(seed, fault, fault.file(path, rng), original, np.zeros((0, 2), np.int64))


def _number(fault: RecordingFault) -> int:
    return zlib.crc32(fault.name.encode())


def _stamps(messages: Messages) -> IntArray:
    scans = [event for event in messages.events if event.topic in (SCAN, "/cloud") and hasattr(event.body, "header")]
    rows = [(stamp_of(event.body), event.true_ns) for event in scans]
    return np.array(rows, np.int64).reshape(-1, 2)


@cache
def _scratch() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="sound"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def _sound_bag(storage: Storage) -> Path:
    folder = _scratch() / storage
    folder.mkdir()
    return sound(f"bag.{storage}", folder, None)
