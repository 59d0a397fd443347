"""Folders of pictures as other people's recorders write them: stamps, lists, scales and sizes of every kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.command import refused, waychair
from waychair.errors import ConfigError, RecordingDamaged
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.recordings.rgbd_folders import RgbdSettings, read_truth
from waychair.recordings.stamps import rows_of, stamp_from_text, unit_of_stamps

START = 1_305_031_229_528_748_000
STEP = 33_333_333
COUNT = 6


def stamps_ns() -> list[int]:
    return [START + k * STEP for k in range(COUNT)]


def seconds(at_ns: int, digits: int = 9) -> str:
    whole, part = divmod(at_ns, 10**9)
    return f"{whole}.{part:09d}"[: len(str(whole)) + 1 + digits]


def write_pictures(
    folder: Path, *, units: float = 5000.0, size: tuple[int, int] = (640, 480), kind: type = np.uint16
) -> Path:
    """Write rgb/K.png and depth/K.png of a slanted wall 1 to 3 m away, without lists."""
    width, height = size
    metres = np.linspace(1.0, 3.0, width, dtype=np.float32)[None].repeat(height, axis=0)
    noise = np.random.default_rng(4).integers(0, 255, (height, width, 3), np.uint8)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for k in range(COUNT):
        cv2.imwrite(str(folder / "rgb" / f"{k}.png"), noise)
        cv2.imwrite(str(folder / "depth" / f"{k}.png"), (metres * units).astype(kind))
    return folder


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp("pictures") / "desk_fr1")


def read(folder: Path, lines: list[str], **settings: object) -> Recording:
    (folder / "associations.txt").write_text("\n".join(lines) + "\n")
    try:
        return read_recording(folder, InputSettings(rgbd=RgbdSettings(**settings)))  # type: ignore[arg-type]
    finally:
        (folder / "associations.txt").unlink()


def stamps_of(recording: Recording) -> list[int]:
    return [frame.stamp_ns for frame in recording.pictures()]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (lambda ns: seconds(ns), ""),
        (lambda ns: f"{ns // 10**9}{ns % 10**9:09d}"[0] + "." + f"{ns}"[1:] + "e+09", ""),  # 1.305031229528748000e+09
        (lambda ns: str(ns), "nanoseconds"),
        (lambda ns: str(ns // 1000), "microseconds"),
        (lambda ns: f"{ns / 1e6:.6f}", "milliseconds"),
        (lambda ns: f"{ns}.0", "nanoseconds"),
    ],
)
def test_a_stamp_is_read_exactly_however_it_is_written(pictures: Path, text: Callable[[int], str], told: str) -> None:
    lines = [f"{text(ns)} rgb/{k}.png {text(ns)} depth/{k}.png" for k, ns in enumerate(stamps_ns())]
    recording = read(pictures, lines)
    tolerance = 1000 if told in ("microseconds", "milliseconds") else 0
    assert np.abs(np.array(stamps_of(recording)) - np.array(stamps_ns())).max() <= tolerance
    assert [told in warning for warning in recording.warnings] == ([True] if told else [])


@pytest.mark.parametrize(
    "line",
    [
        "{s},rgb/{k}.png,{s},depth/{k}.png",
        "{s}, rgb/{k}.png, {s}, depth/{k}.png",
        "{s}; rgb/{k}.png; {s}; depth/{k}.png",
        "{c};rgb/{k}.png;{c};depth/{k}.png",
        "{c} rgb/{k}.png {c} depth/{k}.png",
        "{s}\trgb/{k}.png\t{s}\tdepth/{k}.png",
        "{s} depth/{k}.png {s} rgb/{k}.png",
        "{s} ./rgb/{k}.png {s} ./depth/{k}.png",
        "{s} rgb\\{k}.png {s} depth\\{k}.png",
    ],
)
def test_separators_decimal_commas_and_either_order_are_understood(pictures: Path, line: str) -> None:
    lines = ["\ufefftime,file,time,file", "% of another program"] if "," in line else ["# time file"]
    for k, ns in enumerate(stamps_ns()):
        lines.append(line.format(s=seconds(ns), c=seconds(ns).replace(".", ","), k=k))
    recording = read(pictures, lines)
    assert stamps_of(recording) == stamps_ns()
    assert recording.warnings == ()
    assert {frame.image.shape for frame in recording.pictures()} == {(480, 640, 3)}


@pytest.mark.parametrize("text", ["nan", "inf", "1,3,5e", "-", "0x4d", "noon"])
def test_a_stamp_that_is_none_is_named_with_its_line(pictures: Path, text: str) -> None:
    good = [f"{seconds(ns)} rgb/{k}.png {seconds(ns)} depth/{k}.png" for k, ns in enumerate(stamps_ns())]
    good[2] = f"{text} rgb/2.png 1.0 depth/2.png"
    with pytest.raises(RecordingDamaged, match=r"associations\.txt line 3 "):
        read(pictures, good)


def test_separate_lists_and_names_of_files_are_read_by_the_same_rules(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "fr2_room")
    for kind, late in (("rgb", 0), ("depth", 5_000_000)):
        lines = [f"{(ns + late) * 1e-9:.18e} {k}.png" for k, ns in enumerate(stamps_ns())]
        (folder / f"{kind}.txt").write_text("\n".join(lines))
    listed = read_recording(folder)
    assert listed.picture_count == COUNT
    assert np.abs(np.array(stamps_of(listed)) - np.array(stamps_ns())).max() < 500  # what a float of seconds resolves
    for kind in ("rgb", "depth"):
        (folder / f"{kind}.txt").unlink()
        for k, ns in enumerate(stamps_ns()):
            (folder / kind / f"{k}.png").rename(folder / kind / f"{ns}.png")
        (folder / kind / "Thumbs.db").write_bytes(b"no picture")
    named = read_recording(folder)
    assert stamps_of(named) == stamps_ns()
    assert all("nanoseconds" in warning for warning in named.warnings)


def test_the_truth_goes_by_the_same_rules(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "fr2_room")
    (folder / "groundtruth.txt").write_text(f"timestamp,tx,ty,tz,qx,qy,qz,qw\n{START},1,2,3,0,0,0,1\n")
    truth = read_truth(folder)
    assert truth.stamps_ns.tolist() == [START]
    np.testing.assert_allclose(truth.positions, [[1.0, 2.0, 3.0]])


def test_units_of_stamps_that_do_not_count_from_1970_are_told_by_their_steps() -> None:
    assert unit_of_stamps(["0", "33", "66"]) == "ms"
    assert unit_of_stamps(["0", "33333", "66666"]) == "us"
    assert unit_of_stamps(["12000000000", "12033333333"]) == "ns"
    assert unit_of_stamps(["1", "2", "3"]) == "s"
    assert unit_of_stamps(["100.0", "200.0"]) == "s"
    assert unit_of_stamps([]) == "s"
    assert stamp_from_text("1.305031229528748035e+09") == 1_305_031_229_528_748_035
    assert rows_of("a,b\n1,2\n")[0].number == 2


def test_pairs_that_are_lost_are_counted_and_most_of_them_end_the_run(pictures: Path, tmp_path: Path) -> None:
    lines = [f"{seconds(ns)} rgb/{k}.png {seconds(ns)} depth/{k}.png" for k, ns in enumerate(stamps_ns())]
    some = read(pictures, [*lines[:-1], lines[0]])
    assert some.picture_count == COUNT - 1
    assert some.warnings[-1] == f"1 of {COUNT} pictures are lost: {COUNT - 1} pairs are used"
    short = [f"{ns * 1e-9:.5e} rgb/{k}.png {ns * 1e-9:.5e} depth/{k}.png" for k, ns in enumerate(stamps_ns())]
    with pytest.raises(RecordingDamaged, match=rf"only 1 of {COUNT} pictures .* too few digits"):
        read(pictures, short)
    gone = write_pictures(tmp_path / "fr1_gone")
    for k in range(1, COUNT):
        (gone / "rgb" / f"{k}.png").unlink()
    (gone / "associations.txt").write_text("\n".join(lines))
    sentence = refused(waychair("map", gone, "-o", tmp_path / "out"))
    assert "fr1_gone" in sentence
    assert f"{COUNT - 1} of {COUNT} colour pictures" in sentence
    assert "missing, the first of them rgb/1.png" in sentence


@pytest.mark.parametrize(("units", "scale"), [(1000.0, 1000), (10000.0, 10000), (256.0, 256)])
def test_depth_of_another_scale_is_doubted_with_the_likely_one(tmp_path: Path, units: float, scale: int) -> None:
    folder = write_pictures(tmp_path / "fr3_room", units=units)
    doubted = read_recording(folder)
    if scale == 10000:  # everything twice as far, which a large room is
        assert next(doubted.pictures()).depth[5, 5] == pytest.approx(2.0, abs=0.05)
    else:
        (warning,) = doubted.warnings
        assert f"({scale} would make it 2.00 m)" in warning
        assert "--depth-scale" in warning
    right = read_recording(folder, InputSettings(rgbd=RgbdSettings(depth_scale=units)))
    assert right.warnings == ()
    assert next(right.pictures()).depth[5, 639] == pytest.approx(3.0, abs=0.01)
    assert f"{units:g} depth units to a metre" in right.source


def test_float_depth_is_metres_and_depth_for_the_eye_is_named(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "fr3_room")
    for k in range(COUNT):
        depth = cv2.imread(str(folder / "depth" / f"{k}.png"), cv2.IMREAD_UNCHANGED)
        (folder / "depth" / f"{k}.png").unlink()
        cv2.imwrite(str(folder / "depth" / f"{k}.tiff"), depth.astype(np.float32) / 5000.0)
    metres = read_recording(folder)
    assert metres.warnings == ()
    assert next(metres.pictures()).depth[5, 639] == pytest.approx(3.0, abs=0.01)
    eye = write_pictures(tmp_path / "fr1_eye", units=80.0, kind=np.uint8)
    recording = read_recording(eye)
    assert list(recording.pictures()) == []
    assert recording.unread == {"depth picture has 8 bits: it was made for the eye, not as distances": COUNT}


def test_pictures_of_another_size_scale_a_known_camera_and_doubt_any_other(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "fr1_room", size=(320, 240))
    half = read_recording(folder)
    assert "its matrix was scaled by 0.5" in half.warnings[0]
    matrix = next(half.pictures()).camera_matrix
    assert (matrix[0, 0], matrix[0, 2]) == (pytest.approx(517.306 / 2), pytest.approx(318.643 / 2, abs=0.3))
    given = read_recording(folder, InputSettings(rgbd=RgbdSettings(camera="525,525,319.5,239.5")))
    (warning,) = given.warnings
    assert "far from the middle of the pictures of 320 x 240 pixels" in warning
    assert "--camera 262" in warning
    assert next(given.pictures()).camera_matrix[0, 0] == 525.0
    assert read_recording(folder, InputSettings(rgbd=RgbdSettings(camera="260,260,158,121"))).warnings == ()


def test_the_option_and_the_line_that_is_printed_tell_scale_and_camera(data_dir: Path, tmp_path: Path) -> None:
    desk = data_dir / "rgbd_tum_fr1_rpy_head"
    rows = [row.fields for row in rows_of((desk / "associations.txt").read_text())[:8]]
    folder = tmp_path / "desk"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for _, colour, _, depth in rows:
        cv2.imwrite(str(folder / colour), cv2.imread(str(desk / colour)))
        units = cv2.imread(str(desk / depth), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(folder / depth), units // 5)
    (folder / "associations.txt").write_text("\n".join(",".join(row) for row in rows))
    options = ("--camera", "fr1", "--depth-scale", "1000")
    done = waychair("map", folder, "-o", tmp_path / "out", *options)
    assert done.returncode == 0, done.stderr
    assert "camera by fr1: 517.3,516.5,318.6,255.3, 1000 depth units to a metre: 8 of 8 pictures placed" in done.stdout
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert "1000 depth units to a metre" in report["source"]
    assert (report["listed"], report["placed"]) == (8, 8)
    assert report["warnings"] == []
    assert "depth_scale" in refused(waychair("map", folder, "-o", tmp_path / "no", "--depth-scale=-1"))
    with pytest.raises(ConfigError, match="depth_scale"):
        RgbdSettings(depth_scale=-1.0)
