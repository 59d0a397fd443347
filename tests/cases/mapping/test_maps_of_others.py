"""Maps as other programs write them: unknown cells, white other than 255, transparency, sizes, and keys of their YAML."""

from __future__ import annotations

import logging
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.cli.command import refused, waychair
from waychair.errors import GridTooLarge, MapError, MapNotFound
from waychair.maps.folders import map_files
from waychair.maps.folders.depth_layer import load_depth_layer, save_depth_layer
from waychair.maps.folders.map_files import load_map, save_map
from waychair.maps.grid import cells as grid_cells
from waychair.maps.grid import map_images, occupancy
from waychair.maps.grid.cells import coarser
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.types import OccupancyGrid, Odometry, Pose2, Scan, SensorFrame, Twist

SAVED: dict[str, Any] = {
    "image": "map.pgm",
    "mode": "trinary",
    "resolution": 0.05,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.25,
}
"""The YAML of nav2's map saver; keys set to ... are left out by `written`."""

THREE = [[0, 205, 254]]
WALL, UNKNOWN, FREE = 100, -1, 0


def written(folder: Path, data: bytes, /, **changes: Any) -> Path:
    """A map folder of this image file and of `SAVED` with changes."""
    folder.mkdir(exist_ok=True)
    values = {key: value for key, value in {**SAVED, **changes}.items() if value is not ...}
    (folder / "map.yaml").write_text(yaml.safe_dump(values))
    (folder / str(values["image"])).write_bytes(data)
    return folder


def read(folder: Path) -> tuple[list[list[int]], list[str]]:
    """The cells, top row first, and the warnings."""
    warnings: list[str] = []
    grid = load_map(folder, warnings.append)
    return grid.cells[::-1].tolist(), warnings


def pgm(rows: Any, white: int = 255) -> bytes:
    """A PGM of bytes, or of two bytes a value."""
    values = np.asarray(rows)
    kind = np.dtype(np.uint8 if white < 256 else ">u2")
    return b"P5\n%d %d\n%d\n" % (values.shape[1], values.shape[0], white) + values.astype(kind).tobytes()


def png(rows: Any, colour: int = 0, bits: int = 8, chunks: tuple[tuple[bytes, bytes], ...] = ()) -> bytes:
    """A PNG from its parts, since OpenCV writes neither palettes nor grey with alpha. `rows`: (H, W) or (H, W, C)."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    values = np.asarray(rows, np.dtype(np.uint8 if bits == 8 else ">u2"))
    head = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], bits, colour, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in values))
    parts = [(b"IHDR", head), *chunks, (b"IDAT", data), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def palette(*shades: int) -> tuple[bytes, bytes]:
    return b"PLTE", bytes(shade for each in shades for shade in (each, each, each))


@given(st.floats(0.197, 0.6))
def test_what_a_map_saver_left_unknown_is_unknown_whatever_the_threshold_says(
    tmp_path_factory: pytest.TempPathFactory, threshold: float
) -> None:
    folder = written(tmp_path_factory.mktemp("map"), pgm(THREE * 5), free_thresh=threshold)
    cells, warnings = read(folder)
    assert cells == [[WALL, UNKNOWN, FREE]] * 5
    (warning,) = warnings
    assert f"{folder / 'map.yaml'}: 5 cells of the shade 205" in warning
    assert f"although free_thresh {threshold:g} would" in warning
    assert warning.endswith("write free_thresh: 0.196")


def test_a_map_with_the_threshold_that_fits_is_read_without_a_word(tmp_path: Path) -> None:
    assert read(written(tmp_path / "a", pgm(THREE), free_thresh=0.196)) == ([[WALL, UNKNOWN, FREE]], [])
    assert read(written(tmp_path / "b", pgm([[0, 254, 255]]))) == ([[WALL, FREE, FREE]], [])


@pytest.mark.parametrize(
    ("image", "name"),
    [
        (png(THREE), "map.png"),
        (png(np.array(THREE) * 257, bits=16), "map.png"),
        (png(np.array(THREE) << 8, bits=16), "map.png"),
        (png([[[s, s, s] for s in THREE[0]]], colour=2), "map.png"),
        (png([[[s, s, s, 255] for s in THREE[0]]], colour=6), "map.png"),
        (png([[[s, 255] for s in THREE[0]]], colour=4), "map.png"),
        (png([[0, 1, 2]], colour=3, chunks=(palette(*THREE[0]),)), "map.png"),
        (cv2.imencode(".bmp", np.array(THREE, np.uint8))[1].tobytes(), "map.bmp"),
        (b"P2\n# hand made\n3 1\n255\n0 205 254\n", "map.pgm"),
        (b"P6\n3 1\n255\n" + bytes([0, 0, 0, 205, 205, 205, 254, 254, 254]), "map.pgm"),
        (pgm([[0, 205 * 257, 254 * 257]], 65535), "map.pgm"),
        (pgm([[0, 80, 100]], 100), "map.pgm"),
        (b"P2\n3 1\n15\n0 12 15\n", "map.pgm"),
    ],
    ids=range(13),
)
def test_the_image_of_a_saver_is_known_in_every_kind_of_file(tmp_path: Path, image: bytes, name: str) -> None:
    cells, (warning,) = read(written(tmp_path, image, image=name))
    assert cells == [[WALL, UNKNOWN, FREE]]
    assert "1 cells of the shade 205" in warning


def test_a_saved_map_that_was_edited_with_a_soft_brush_is_still_known(tmp_path: Path) -> None:
    image = np.full((40, 40), 205)
    image[10:20] = 254
    image[5, :20] = 0
    image[6, :6] = [180, 130, 80, 220, 240, 150]
    cells, (warning,) = read(written(tmp_path, pgm(image)))
    assert np.array(cells)[30, 0] == UNKNOWN
    assert f"{int((image == 205).sum())} cells" in warning


def test_a_drawing_in_all_greys_is_read_by_its_thresholds(tmp_path: Path) -> None:
    cells, warnings = read(written(tmp_path, pgm(np.arange(256)[None])))
    assert warnings == []
    assert (cells[0][205], cells[0][190], cells[0][80]) == (FREE, UNKNOWN, WALL)


@pytest.mark.parametrize("white", [1, 2, 15, 100, 127, 254, 255, 256, 1023, 4095, 65535])
@pytest.mark.parametrize("text", [False, True])
def test_the_white_of_a_pgm_is_what_its_header_says(tmp_path: Path, white: int, text: bool) -> None:
    shades = np.unique([0, white // 2, white])
    image = f"P2\n{len(shades)} 1\n{white}\n{' '.join(map(str, shades))}\n".encode() if text else pgm([shades], white)
    cells, _ = read(written(tmp_path, image))
    assert (cells[0][0], cells[0][-1]) == (WALL, FREE)
    assert cells[0][1:-1] in ([], [UNKNOWN])


@pytest.mark.parametrize("part", [1, 3, 4, 7, 1000])
def test_a_text_pgm_is_read_in_parts(tmp_path: Path, part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_images, "_TEXT_AT_ONCE", part)
    shades = [0, 7, 254, 99, 120, 255, 31, 254]
    text = f"P2\n4 2\n255\n{' '.join(map(str, shades[:4]))}\n# second row\n{'  '.join(map(str, shades[4:]))}"
    folder = written(tmp_path, text.encode())
    assert map_images.read_image(folder / "map.pgm").shades.ravel().tolist() == shades


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (b"P5\n0 4\n255\n", "has no pixels"),
        (b"P5\n2 1\n0\n\0\0", "announces 0 for white, which must be 1 to 65535"),
        (b"P5\n2 1\n70000\n" + bytes(4), "announces 70000 for white"),
        (pgm([[0, 200]], 100), "holds the value 200 beyond its white of 100"),
        (b"P2\n2 1\n255\n0 grey\n", "holds text that is not a number"),
        (b"P2\n2 1\n255\n0 -4\n", "not a number|beyond|-4"),
        (cv2.imencode(".jpg", np.array(THREE, np.uint8))[1].tobytes(), "is a JPEG file; save it as PNG"),
        (cv2.imencode(".tiff", np.array(THREE, np.uint8))[1].tobytes(), "is a TIFF file; save it as PNG"),
    ],
    ids=range(8),
)
def test_an_image_that_cannot_be_trusted_is_refused_with_its_fault(tmp_path: Path, image: bytes, said: str) -> None:
    with pytest.raises(MapError, match=said):
        load_map(written(tmp_path, image))


@pytest.mark.parametrize(
    "image",
    [
        png([[[0, 255], [90, 0], [255, 255]]], colour=4),
        png([[[0, 0, 0, 255], [9, 9, 9, 128], [255, 255, 255, 255]]], colour=6),
        png([[0, 1, 2]], colour=3, chunks=(palette(0, 128, 255), (b"tRNS", bytes([255, 0, 255])))),
        png([[0, 128, 255]], chunks=((b"tRNS", struct.pack(">H", 128)),)),
        png(np.array([[0, 128, 255]]) * 257, bits=16, chunks=((b"tRNS", struct.pack(">H", 128 * 257)),)),
        png([[[0, 0, 0], [7, 8, 9], [255, 255, 255]]], colour=2, chunks=((b"tRNS", struct.pack(">HHH", 7, 8, 9)),)),
    ],
    ids=range(6),
)
@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_transparent_pixel_is_unknown_in_every_kind_of_png(tmp_path: Path, image: bytes, mode: str) -> None:
    assert read(written(tmp_path, image, image="map.png", mode=mode)) == ([[WALL, UNKNOWN, FREE]], [])


def test_a_negative_of_a_saved_map_keeps_its_unknown(tmp_path: Path) -> None:
    cells, (warning,) = read(written(tmp_path, pgm([[255, 50, 1]]), negate=True))
    assert cells == [[WALL, UNKNOWN, FREE]]
    assert "free_thresh 0.25" in warning


@pytest.mark.parametrize(("changes", "right"), [({"negate": 1}, "negate: 0"), ({"mode": "raw"}, "mode: trinary")])
def test_a_yaml_that_makes_floor_of_the_walls_is_refused(tmp_path: Path, changes: dict[str, Any], right: str) -> None:
    with pytest.raises(MapError, match=f"would make free floor of black.*write `{right}`"):
        load_map(written(tmp_path, pgm(THREE), **changes))


def test_scale_mode_without_transparency_keeps_its_unknown(tmp_path: Path) -> None:
    for grey in (127, 128):
        cells, (warning,) = read(written(tmp_path / str(grey), pgm([[0, grey, 255]]), mode="scale"))
        assert cells == [[WALL, UNKNOWN, FREE]]
        assert "127 or 128" in warning
        assert "although mode scale" in warning
    shades = pgm([[0, 60, 128, 190, 255]])
    assert read(written(tmp_path / "shades", shades, mode="scale"))[1] == []


def test_raw_values_are_percents(tmp_path: Path) -> None:
    assert read(written(tmp_path, pgm([[0, 42, 100, 255]]), mode="raw")) == ([[0, 42, 100, -1]], [])
    assert read(written(tmp_path, pgm(np.array([[0, 42, 100, 255]]) * 257, 65535), mode="raw"))[0] == [[0, 42, 100, -1]]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"free_thresh": ..., "free_treshold": 0.2},
            "lacks free_thresh; rename its key 'free_treshold' to free_thresh",
        ),
        ({"negate": ..., "resolution": ...}, "lacks resolution, negate; add them"),
        ({"origin": [0.0, 0.0, 180]}, "its yaw must be in radians, at most a full turn"),
        ({"mode": "Trinary"}, "one of trinary, scale, raw"),
    ],
)
def test_a_key_that_is_wrong_is_named(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(MapError, match=said):
        load_map(written(tmp_path, pgm(THREE), **changes))


@pytest.mark.parametrize("path", ["/home/somebody/maps/map.pgm", "C:\\maps\\map.pgm", "maps/map.pgm"])
def test_the_path_of_another_computer_is_answered_with_the_image_beside_the_yaml(tmp_path: Path, path: str) -> None:
    folder = written(tmp_path, pgm(THREE))
    (folder / "map.yaml").write_text(yaml.safe_dump({**SAVED, "image": path}))
    with pytest.raises(MapNotFound, match=r"map\.pgm lies beside map\.yaml; write `image: map\.pgm`"):
        load_map(folder)


def test_readers_that_pass_no_channel_log_the_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        load_map(written(tmp_path, pgm(THREE)))
    assert "map savers write for unknown" in caplog.text


def u_of_corridors() -> np.ndarray:
    """A corridor round three sides of a block that nobody has seen, behind glass on its inner side; top row first."""
    image = np.full((180, 240), 205)
    image[10:170, 10:230] = 0
    image[12:168, 12:228] = 254
    image[12:140, 52:188] = 205
    return image


def test_a_path_does_not_lead_through_what_nobody_has_seen(tmp_path: Path) -> None:
    folder = written(tmp_path, pgm(u_of_corridors()))
    ends = ("--start", "1.6,7", "--goal", "10.4,7")
    done = waychair("plan", "--map", folder, *ends)
    assert done.returncode == 0
    assert float(done.stdout.split(" m ")[0]) > 15
    (line,) = done.stderr.splitlines()
    assert line.startswith("warning: ")
    assert "stay unknown, although free_thresh 0.25" in line
    assert waychair("plan", "--map", folder, *ends, "--quiet").stderr == ""


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_joined_cells_are_occupied_where_a_part_is_and_free_where_all_of_it_is(times: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([-1, 0, 30, 65, 100], np.int8), rng.integers(1, 14, 2), p=[0.2, 0.5, 0.1, 0.1, 0.1])
    grid = OccupancyGrid(cells, 0.05, Pose2(-1.0, 2.0, 0.3))
    large = coarser(grid, times)
    assert large.map_from_grid == grid.map_from_grid
    assert large.resolution == pytest.approx(0.05 * times)
    for row, line in enumerate(large.cells.tolist()):
        for col, value in enumerate(line):
            part = cells[row * times : (row + 1) * times, col * times : (col + 1) * times]
            partly = (part < 0).any() or part.size < times * times
            expected = int(part.max()) if part.max() >= 65 or not partly else -1
            assert value == expected


def test_a_map_is_read_with_larger_cells_on_wish(tmp_path: Path) -> None:
    cells = np.zeros((40, 60), np.int8)
    cells[10, 20] = 100
    save_map(tmp_path, OccupancyGrid(cells, 0.05, Pose2(1.0, 2.0, 0.0)))
    grid = load_map(tmp_path, resolution=0.2)
    assert (grid.cells.shape, grid.resolution) == ((10, 15), pytest.approx(0.2))
    assert np.argwhere(grid.cells == 100).tolist() == [[2, 5]]
    for wanted in (0.12, 0.02, float("nan"), -1.0):
        with pytest.raises(MapError, match=r"cells of 0\.05 m, which cannot be joined.*give 0\.05 or a multiple"):
            load_map(tmp_path, resolution=wanted)


def test_a_map_that_is_too_large_is_read_with_larger_cells_and_its_layer_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_files, "MOST_CELLS", 1000)
    cells = np.zeros((50, 70), np.int8)
    cells[25] = 100
    grid = OccupancyGrid(cells, 0.05)
    save_map(tmp_path, grid)
    save_depth_layer(tmp_path, OccupancyGrid(cells, 0.05))
    warnings: list[str] = []
    large = load_map(tmp_path, warnings.append)
    assert large.cells.shape == (25, 35)
    assert "70 by 50 cells, more than the 1000 that can be planned on" in warnings[0]
    assert "joined to cells of 0.1 m, as by --resolution 0.1" in warnings[0]
    layer = load_depth_layer(tmp_path, large)
    assert layer is not None
    assert layer.cells.shape == large.cells.shape


def test_plan_takes_larger_cells(tmp_path: Path) -> None:
    folder = written(tmp_path, pgm(u_of_corridors()), free_thresh=0.196)
    ends = ("--start", "1.6,7", "--goal", "10.4,7")
    fine, large = (waychair("plan", "--map", folder, *ends, *more) for more in ((), ("--resolution", "0.1")))
    lengths = [float(done.stdout.split(" m ")[0]) for done in (fine, large)]
    assert lengths[1] == pytest.approx(lengths[0], abs=0.5)
    said = refused(waychair("plan", "--map", folder, *ends, "--resolution", "0.07"))
    assert "give 0.05 or a multiple, such as 0.1" in said


def square_drive() -> LiveMapping:
    """A drive round a hall of 24 m by 16 m, with a scan at each metre."""
    live = LiveMapping(LiveMappingSettings(), Pose2())
    angles = np.linspace(-math.pi, math.pi, 361)[:-1]
    for k in range(16):
        x = float(k)
        with np.errstate(divide="ignore"):
            away_x = np.where(np.cos(angles) > 0, 20.0 - x, 4.0 + x) / np.abs(np.cos(angles))
            away_y = np.where(np.sin(angles) > 0, 10.0, 6.0) / np.abs(np.sin(angles))
        scan = Scan(
            stamp_ns=k * 10**9,
            ranges=np.minimum(away_x, away_y).astype(np.float32),
            angle_min=float(angles[0]),
            angle_step=float(angles[1] - angles[0]),
            range_min=0.05,
            range_max=30.0,
        )
        odometry = Odometry(k * 10**9, Pose2(x, 0.0, 0.0), Twist(1.0, 0.0))
        live.include(live.reckon(SensorFrame(k * 10**9, scan=scan, wheels=(odometry,))))
    return live


def test_a_site_too_large_for_the_cells_is_drawn_with_larger_ones_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = square_drive()
    usual.settle()
    assert usual.size_warning == ""
    monkeypatch.setattr(occupancy, "MOST_CELLS", 60_000)
    live = square_drive()
    live.settle()
    assert live.grid().resolution == 0.1
    assert live.size_warning.startswith("the map is drawn with cells of 0.1 m, as cells of 0.05 m would be more")
    assert "--resolution 0.1" in live.size_warning
    extents = [np.array(grid.cells.shape) * grid.resolution for grid in (usual.grid(), live.grid())]
    np.testing.assert_allclose(*extents, atol=1.3)
    walls = [(grid.cells >= 65).sum() * grid.resolution for grid in (usual.grid(), live.grid())]
    assert walls[1] == pytest.approx(walls[0], rel=0.4)


def test_poses_that_jump_out_of_any_site_are_refused_and_not_drawn_with_useless_cells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(occupancy, "MOST_CELLS", 2_000)
    with pytest.raises(GridTooLarge, match=r"cells of 0\.2 m that can be planned on: check the poses for jumps"):
        square_drive().settle()


def test_all_that_makes_or_reads_a_map_has_one_limit() -> None:
    assert occupancy.MOST_CELLS == map_files.MOST_CELLS == grid_cells.MOST_CELLS
