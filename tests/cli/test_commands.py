"""The commands as a user types them: their files, and one clear sentence per error."""

from __future__ import annotations

import errno
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command import WAYCHAIR, refused, started, waychair
from waychair.maps.folders.map_files import load_map, save_map
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import read_tum
from waychair.types import OccupancyGrid, Odometry, Pose2, Scan


def room_scan(pose: Pose2, stamp_ns: int) -> Scan:
    """Return a scan inside a 10 x 6 m room with a pillar."""
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    c, s = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    with np.errstate(divide="ignore"):
        walls = [np.where(c > 0, (10 - pose.x) / c, -pose.x / c), np.where(s > 0, (6 - pose.y) / s, -pose.y / s)]
    to_pillar = np.array([7.0 - pose.x, 2.0 - pose.y])
    along = c * to_pillar[0] + s * to_pillar[1]
    beside = np.abs(c * to_pillar[1] - s * to_pillar[0])
    pillar = np.where((along > 0) & (beside < 0.4), along - np.sqrt(np.maximum(0.16 - beside**2, 0)), np.inf)
    ranges = np.minimum(np.minimum(*walls), pillar)
    return Scan(stamp_ns, ranges.astype(np.float32), -math.pi, math.tau / 360, range_max=30.0)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a ROS 2 bag of a short drive through the room."""
    path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    with RecordingWriter(path, Pose2()) as writer:
        for k in range(40):
            stamp = 10**18 + k * 10**8
            pose = Pose2(2.0 + 0.1 * k, 3.0, 0.01 * k)
            writer.write(Odometry(stamp, pose))
            writer.write(room_scan(pose, stamp))
    return path


@pytest.fixture(scope="module")
def map_folder(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("map") / "room"
    done = started("map", bag, "--out", folder)
    assert done.returncode == 0, done.stderr
    assert "40 scans" in done.stdout
    return folder


def test_map_writes_the_six_files_and_nothing_else(map_folder: Path) -> None:
    names = {path.name for path in map_folder.iterdir()}
    assert names >= {"map.yaml", "map.pgm", "trajectory.tum", "graph.g2o", "config.yaml", "report.json"}
    assert not [name for name in names if name.startswith(".")]
    assert len(read_tum(map_folder / "trajectory.tum").stamps_ns) == 40
    assert json.loads((map_folder / "report.json").read_text())["frames"] == 40
    grid = load_map(map_folder)
    assert 40 < (grid.cells == 0).sum() * grid.resolution**2 < 62


def test_the_printed_configuration_gives_the_same_map_again(bag: Path, map_folder: Path, tmp_path: Path) -> None:
    done = waychair("map", bag, "--out", tmp_path / "again", "--config", map_folder / "config.yaml", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    for name in ("trajectory.tum", "map.pgm", "graph.g2o", "config.yaml"):
        assert (tmp_path / "again" / name).read_bytes() == (map_folder / name).read_bytes()


def test_places_are_added_listed_and_moved(map_folder: Path) -> None:
    assert "has no places" in waychair("places", "--map", map_folder).stdout
    assert waychair("places", "--map", map_folder, "--add", "desk", "1.0,0.5,1.57").returncode == 0
    added = waychair("places", "--map", map_folder / "map.yaml", "--add", "door", "-1.0,-0.5")
    assert added.stdout.splitlines() == ["desk: 1.00, 0.50, 1.57", "door: -1.00, -0.50, 0.00"]
    assert "desk: 2.00" in waychair("places", "--map", map_folder, "--move", "desk", "2,0,0").stdout


@pytest.mark.parametrize(
    ("place", "named"),
    [(("x", "900,0,0"), "outside the map"), (("x", "1,zwei"), "X,Y"), (("x", "1,nan,0"), "X,Y"), (("x", "1"), "X,Y")],
)
def test_an_impossible_place_is_refused(map_folder: Path, place: tuple[str, str], named: str) -> None:
    before = waychair("places", "--map", map_folder).stdout
    assert named in refused(waychair("places", "--map", map_folder, "--add", *place))
    assert waychair("places", "--map", map_folder).stdout == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--worlds", "1.9"), "'1.9' is not a whole number"),
        (("--worlds", "x"), "unable to convert"),
        (("--starts", "0.5"), "'0.5' is not a whole number"),
        (("--jobs", "0"), "Must be >= 1"),
        (("--jobs", "-1"), "Must be >= 1"),
    ],
)
def test_impossible_counts_are_refused(tmp_path: Path, arguments: tuple[str, str], said: str) -> None:
    done = waychair("barn", tmp_path, *arguments)
    assert done.returncode != 0
    assert said in done.stdout + done.stderr


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    assert "there is no folder" in refused(waychair("barn", tmp_path / "none"))
    done = waychair("barn", "")
    assert done.returncode != 0
    assert "the path is empty" in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "a file: No space left on device; make room"),
        (OSError(errno.EACCES, "Permission denied", "/x/map.yaml"), "/x/map.yaml: Permission denied; give this user"),
        (MemoryError(), "memory ran out"),
    ],
)
def test_an_error_of_the_operating_system_gives_one_sentence(
    monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    def refuse(**_: object) -> None:
        raise error

    monkeypatch.setattr("waychair.cli.main.app", refuse)
    assert said in refused(waychair("config"))


def test_a_full_output_gives_one_sentence_and_nothing_else() -> None:
    for arguments in (("--version",), ("config",)):  # less and more than one write
        with Path("/dev/full").open("w") as full:
            command = [str(WAYCHAIR), *arguments]
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert line.startswith("waychair: cannot read or write a file: No space left on device")


def test_a_place_in_a_wall_is_refused(tmp_path: Path) -> None:
    cells = np.zeros((20, 20), np.int8)
    cells[10, 10] = 100
    save_map(tmp_path, OccupancyGrid(cells, 0.1, Pose2()))
    assert "in a wall" in refused(waychair("places", "--map", tmp_path, "--add", "x", "1.05,1.05,0"))


def bad_logs(folder: Path) -> dict[str, Path]:
    """Return inputs that cannot be mapped."""
    texts = {"empty.clf": "", "noise.log": "\x01\x02 what is this", "noscan.clf": "PARAM a b\nODOM 0 0 0 0 0 0 1 h 1\n"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "cut.clf.gz").write_bytes(b"\x1f\x8b\x08\x00broken")
    (folder / "cut.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\x00" * 40)
    (folder / "cut.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\xff" * 40)
    (folder / "cut.db3").write_bytes(b"SQLite format 3\x00" + b"\x00" * 40)
    (folder / "nothing_in_it").mkdir()
    names = [*texts, "cut.clf.gz", "cut.bag", "cut.mcap", "cut.db3", "nothing_in_it"]
    return {name: folder / name for name in [*names, "missing.clf"]}


@pytest.mark.parametrize(
    "name",
    [
        "empty.clf",
        "noise.log",
        "noscan.clf",
        "cut.clf.gz",
        "cut.bag",
        "cut.mcap",
        "cut.db3",
        "nothing_in_it",
        "missing.clf",
    ],
)
def test_a_bad_recording_gives_one_sentence_and_leaves_no_files(name: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    sentence = refused(waychair("map", bad_logs(tmp_path)[name], "--out", out))
    assert name in sentence
    assert not out.exists()


def test_a_bad_configuration_names_the_key(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("mapper: {key_distanse: 0.3}\n")
    sentence = refused(waychair("map", bag, "--out", tmp_path / "out", "--config", tmp_path / "c.yaml"))
    assert "did you mean 'key_distance'" in sentence
    assert not (tmp_path / "out").exists()


def test_an_output_folder_that_is_a_file_is_named(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    assert "cannot write" in refused(waychair("map", bag, "--out", tmp_path / "out"))
    assert (tmp_path / "out").read_text() == "mine"


def test_a_wrong_topic_is_answered_with_the_topics_in_the_bag(bag: Path, tmp_path: Path) -> None:
    assert "/scan" in refused(waychair("map", bag, "--out", tmp_path / "out", "--scan", "/laser"))


def test_a_missing_map_is_named(tmp_path: Path) -> None:
    assert "none" in refused(started("places", "--map", tmp_path / "none"))


def test_the_default_configuration_is_printed_and_accepted(bag: Path, tmp_path: Path) -> None:
    text = waychair("config").stdout
    assert "key_distance: 0.2  # m, distance driven between key scans" in text
    (tmp_path / "c.yaml").write_text(text)
    assert waychair("map", bag, "--out", tmp_path / "out", "--config", tmp_path / "c.yaml", "--quiet").returncode == 0


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    done = started("--help")
    assert done.returncode == 0
    for name in ("map", "places", "demo", "config"):
        assert f" {name} " in done.stdout
    program = (
        "import sys\nsys.argv = ['waychair', '--help']\nfrom waychair.cli.main import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'numba', 'gtsam', 'cv2', 'scipy', 'matplotlib', 'rosbags'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.nightly
def test_the_demo_needs_no_recording_and_drives_a_shipped_world(tmp_path: Path) -> None:
    command = [str(WAYCHAIR), "demo", "--world", "corridor_t", "--no-surprises", "--headless"]
    command += ["--out", str(tmp_path / "demo")]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "WAYCHAIR_DATA": str(tmp_path / "none")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 goals reached" in done.stdout
    assert "http" not in done.stderr
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert (report["goals_reached"], report["contacts"], report["found"]["found"]) == (3, 0, True)
    assert report["ate_m"] < 0.1
