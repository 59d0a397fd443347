"""The generator of corrupted recordings: every fault changes the recording, and a seed gives the same one again."""

from __future__ import annotations

import copy
import hashlib
import math
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from evaluation.corruptions import drawing
from evaluation.corruptions.drawing import FAULTS, Corrupted, corrupted, fault_of
from evaluation.corruptions.fault import RecordingFault
from evaluation.corruptions.messages import SCAN, BagMessage, Messages
from evaluation.corruptions.odometry_faults import odometry_jumps
from evaluation.corruptions.verdict import RunVerdict, judged, names
from evaluation.corruptions.warm_runner import FinishedRun

SHORT = 60
"""About the number of messages of each topic of a shortened drive, but for those of the lidar."""

RUN = FinishedRun(0, "", 2.0, 3.0, 300.0)


def packed(messages: Messages) -> bytes:
    """Return all that a bag of the messages would hold."""
    store = messages.store
    parts: list[bytes] = []
    for event in messages.events:
        data = bytes(store.serialize_cdr(event.body, event.body.__msgtype__))
        data = data if event.raw is None else event.raw(data)
        parts += [event.topic.encode(), event.kind.encode(), str(event.log_ns).encode(), data]
    return hashlib.sha256(b"|".join(parts)).digest()


def shortened(*, clouds: bool) -> Messages:
    """Return the sound drive with one of many messages of each topic."""
    return copy.deepcopy(_shortened(clouds))


@cache
def sound_bytes(clouds: bool) -> bytes:
    """Return what a bag of the shortened drive would hold."""
    return packed(shortened(clouds=clouds))


@cache
def _shortened(clouds: bool) -> Messages:
    whole = drawing.sound_messages(2, clouds=clouds)
    kept: list[BagMessage] = []
    for topic in dict.fromkeys(event.topic for event in whole.events):
        own = whole.of(topic)
        kept += own if topic in (SCAN, "/cloud") else own[:: max(1, len(own) // SHORT)]
    return Messages(2, sorted(kept, key=lambda event: event.log_ns))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.messages], ids=lambda fault: fault.name)
def test_a_fault_of_messages_changes_them_and_a_seed_does_the_same_again(fault: RecordingFault) -> None:
    assert fault.messages is not None
    clouds = fault.where == "clouds"
    drawn = []
    for seed in (3, 3, 4):
        messages = shortened(clouds=clouds)
        with np.errstate(all="ignore"):
            fault.messages(messages, np.random.default_rng(seed))
            drawn.append(packed(messages))
    assert drawn[0] == drawn[1]
    assert any(each != sound_bytes(clouds) for each in drawn[1:])


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a small bag in a folder and one of ROS 1."""
    folder, made = tmp_path_factory.mktemp("bags"), {}
    for ros, name, storage in ((2, "drive", "mcap"), (1, "drive.bag", "bag")):
        whole = drawing.sound_messages(1 if ros == 1 else 2)
        whole.events = whole.events[:600]
        drawing.write_messages(folder / name, whole, "bag" if storage == "bag" else "mcap")
        made[storage] = folder / name
    return made


def content(path: Path) -> dict[str, bytes]:
    """Return the bytes of a file, or of the files in a folder, by name."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    return {str(file.relative_to(path.parent)): file.read_bytes() for file in files}


@pytest.mark.parametrize(
    "fault", [fault for fault in FAULTS if fault.where == "file" and "part" not in fault.name and "else" not in fault.name],
    ids=lambda fault: fault.name,
)  # fmt: skip
@pytest.mark.parametrize("storage", ["mcap", "bag"])
def test_a_fault_of_files_changes_them_and_a_seed_does_the_same_again(
    tmp_path: Path, bags: dict[str, Path], fault: RecordingFault, storage: str
) -> None:
    assert fault.file is not None
    made = []
    for k in range(2):
        path = tmp_path / str(k) / bags[storage].name
        path.parent.mkdir()
        (shutil.copytree if storage == "mcap" else shutil.copyfile)(bags[storage], path)
        made.append(content(fault.file(path, np.random.default_rng(8))))
    assert made[0] == made[1]
    assert made[0] != content(bags[storage])


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.where == "log"], ids=lambda fault: fault.name)
def test_a_fault_of_a_log_changes_it(tmp_path: Path, fault: RecordingFault) -> None:
    sound = tmp_path / "sound"
    sound.mkdir()
    whole = drawing.sound("log", sound, None)
    made = corrupted(7, fault, tmp_path, None)
    assert made.path.read_bytes() != whole.read_bytes()


def test_as_many_seeds_as_faults_take_each_fault_once() -> None:
    count = len(drawing.faults(None))
    assert {fault_of(seed, None).name for seed in range(count)} == {fault.name for fault in drawing.faults(None)}
    assert [fault_of(seed, None).name for seed in range(count)] != [
        fault_of(seed, None).name for seed in range(count, 2 * count)
    ]


MADE = Corrupted(0, odometry_jumps, Path("drive"), "bag.mcap", np.zeros((0, 2), np.int64))


def test_a_sentence_names_a_fault_by_part_and_kind() -> None:
    assert names(MADE, "warning: /odom: at 20.1 s a jump of 3.0 m that no chair drives is no motion")
    assert not names(MADE, "warning: /imu/data: the turn rates jump")
    assert not names(MADE, "warning: /odom is left alone")


def test_a_sentence_about_the_path_names_the_file_and_the_words_of_the_path_name_nothing() -> None:
    cut = replace(MADE, fault=next(fault for fault in FAULTS if fault.name == "log_is_cut"))
    assert names(cut, "waychair: /a/seed_128/drive.log is empty; copy it again from its source")
    assert not names(cut, "waychair: nothing is empty in /a/seed_128/drive.log")
    assert not names(MADE, "waychair: /a/seed_128/odom jumps")


def test_a_wild_value_of_any_topic_is_true_of_a_file_with_wrong_bytes(tmp_path: Path) -> None:
    text = "warning: /imu/data: one message at 15.7 s has wild acceleration (6.2e+294 m/s^2), and is left out\n"
    flipped = replace(MADE, fault=next(fault for fault in FAULTS if fault.name == "file_holds_other_bytes"))
    write_truth(tmp_path)
    run = FinishedRun(0, text, 2.0, 3.0, 300.0)
    assert judged(flipped, run, tmp_path, RUN, ()).verdict is RunVerdict.MAPS
    assert judged(MADE, run, tmp_path, RUN, ()).verdict is RunVerdict.MISBLAMED


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("", RunVerdict.SILENT_WRONG),
        ("warning: /imu/data turns the other way\n", RunVerdict.SILENT_WRONG),
        ("warning: /odom: a jump that no chair drives\n", RunVerdict.NAMED),
        ("Traceback (most recent call last):\n", RunVerdict.TRACEBACK),
    ],
)
def test_a_map_that_is_wrong_is_judged_by_the_sentences(tmp_path: Path, text: str, verdict: RunVerdict) -> None:
    write_truth(tmp_path, scale=2.0)
    assert judged(MADE, FinishedRun(0, text, 2.0, 3.0, 300.0), tmp_path, RUN, ()).verdict is verdict


def write_truth(folder: Path, scale: float = 1.0) -> None:
    """Write the true trajectory into a map's folder, x times a scale."""
    rows = [
        f"{stamp * 1e-9:.6f} {scale * x:.4f} {y:.4f} 0 0 0 {math.sin(yaw / 2):.6f} {math.cos(yaw / 2):.6f}\n"
        for stamp, (x, y, yaw) in drawing_truth()
    ]
    (folder / "trajectory.tum").write_text("".join(rows))


def drawing_truth() -> list[tuple[int, list[float]]]:
    """Return the stamps [ns] and true poses of the sound drive's scans."""
    from evaluation.corruptions.sound_drive import SECOND, START_NS, sound_drive

    drive = sound_drive()
    return [
        (START_NS + round(time * SECOND), pose)
        for time, pose in zip(drive.scan_times.tolist(), drive.at(drive.scan_times).tolist(), strict=True)
    ]


@pytest.mark.parametrize(
    ("run", "verdict"),
    [
        (FinishedRun(1, "waychair: /odom jumps\n", 7.0, 9.0, 300.0), RunVerdict.TOO_SLOW),
        (FinishedRun(1, "waychair: /odom jumps\n", 2.0, 9.0, 1000.0), RunVerdict.TOO_LARGE),
        (FinishedRun(1, "waychair: the lidar is damaged\n", 2.0, 3.0, 300.0), RunVerdict.MISBLAMED),
        (FinishedRun(1, "waychair: nothing works\n", 2.0, 3.0, 300.0), RunVerdict.UNNAMED),
        (FinishedRun(-11, "", 2.0, 3.0, 300.0), RunVerdict.TRACEBACK),
    ],
)
def test_a_run_that_ends_without_a_map_is_judged(tmp_path: Path, run: FinishedRun, verdict: RunVerdict) -> None:
    assert judged(MADE, run, tmp_path, RUN, ()).verdict is verdict
