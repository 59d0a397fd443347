"""Maps as map_server writes and reads them: round trips, modes, real maps, and broken files."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from waychair.errors import MapError, MapNotFound, OutputError
from waychair.maps.folders.map_files import load_map, save_map
from waychair.types import OccupancyGrid, Pose2

GOOD: dict[str, Any] = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [1.0, 2.0, 0.5],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write_map(folder: Path, pixels: np.ndarray, image: str = "map.pgm", **changes: Any) -> Path:
    """A map with this image (top row first), through OpenCV; keys set to ... are left out."""
    values = {**GOOD, "image": image, **changes}
    (folder / "map.yaml").write_text(yaml.safe_dump({key: value for key, value in values.items() if value is not ...}))
    assert cv2.imwrite(str(folder / image), pixels)
    return folder


def test_the_files_are_those_of_map_server(tmp_path: Path) -> None:
    cells = np.array([[0, 100, -1], [49, 65, 50]], np.int8)
    save_map(tmp_path / "office", OccupancyGrid(cells, 0.05, Pose2(-1.25, 1e-7, 0.1)))
    assert sorted(path.name for path in (tmp_path / "office").iterdir()) == ["map.pgm", "map.yaml"]
    values = yaml.safe_load((tmp_path / "office" / "map.yaml").read_text())
    assert values == {
        "image": "map.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [-1.25, 1e-7, 0.1],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    data = (tmp_path / "office" / "map.pgm").read_bytes()
    assert data.startswith(b"P5\n")
    assert data.endswith(bytes([254, 0, 205, 254, 0, 205])), "the last row of the grid is the first of the image"


def test_an_unknown_cell_is_not_free_by_the_written_thresholds(tmp_path: Path) -> None:
    save_map(tmp_path, OccupancyGrid(np.full((2, 2), -1, np.int8), 0.05))
    values = yaml.safe_load((tmp_path / "map.yaml").read_text())
    assert values["free_thresh"] <= (255 - 205) / 255 <= values["occupied_thresh"]


cells_of_any_value = hnp.arrays(
    np.int8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.integers(-1, 100)
)
metres = st.floats(-1e4, 1e4)


@settings(max_examples=40, deadline=None)
@given(cells_of_any_value, st.floats(0.001, 10.0), metres, metres, st.floats(-3.14, 3.14))
def test_a_map_survives_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, cells: np.ndarray, resolution: float, x: float, y: float, theta: float
) -> None:
    folder = tmp_path_factory.mktemp("map")
    grid = OccupancyGrid(cells, resolution, Pose2(x, y, theta))
    save_map(folder, grid, mode="raw")
    raw = load_map(folder)
    assert (raw.resolution, raw.map_from_grid) == (grid.resolution, grid.map_from_grid)
    np.testing.assert_array_equal(raw.cells, cells)
    save_map(folder / "scale", grid, mode="scale")
    scale = load_map(folder / "scale")
    assert (scale.resolution, scale.map_from_grid) == (grid.resolution, grid.map_from_grid)
    np.testing.assert_array_equal(scale.cells, cells)
    save_map(folder, grid)
    trinary = load_map(folder / "map.yaml")
    expected = np.full(cells.shape, -1)
    expected[cells >= 65] = 100
    expected[(cells >= 0) & (cells < 50)] = 0
    np.testing.assert_array_equal(trinary.cells, expected)


@pytest.mark.parametrize(("name", "shape"), [("brsu-c069", (544, 576)), ("wrs20-arena", (416, 192))])
def test_real_maps_are_read_by_their_pixels(data_dir: Path, tmp_path: Path, name: str, shape: tuple[int, int]) -> None:
    shutil.copy(data_dir / "maps_real" / f"{name}.pgm", tmp_path / "map.pgm")
    shutil.copy(data_dir / "maps_real" / f"{name}.yaml", tmp_path / "map.yaml")
    grid = load_map(tmp_path)
    pixels = np.frombuffer((tmp_path / "map.pgm").read_bytes()[-shape[0] * shape[1] :], np.uint8).reshape(shape)
    assert grid.resolution == 0.05
    assert grid.map_from_grid in (Pose2(-8.0, -8.0, 0.0), Pose2(-5.0, -5.0, 0.0))
    np.testing.assert_array_equal(grid.cells[::-1] == 100, pixels < 89)
    np.testing.assert_array_equal(grid.cells[::-1] == 0, pixels > 205)
    assert (grid.cells == -1).any()
    save_map(tmp_path / "again", grid)
    np.testing.assert_array_equal(load_map(tmp_path / "again").cells, grid.cells)


@pytest.mark.parametrize("name", ["E5/E5_01.png", "E5/E5_layout.png", "HIH/HIH_02.png"])
def test_maps_drawn_by_other_programs_survive_every_mode(data_dir: Path, tmp_path: Path, name: str) -> None:
    image = data_dir / "maps_halmstad" / name
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({**GOOD, "image": str(image)}))
    grid = load_map(tmp_path)
    pixels = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
    assert grid.cells.shape == pixels.shape[:2]
    assert {0, 100} <= set(np.unique(grid.cells).tolist()) <= {-1, 0, 100}
    modes: tuple[Literal["trinary", "scale", "raw"], ...] = ("trinary", "scale", "raw")
    for mode in modes:
        save_map(tmp_path / mode, grid, mode=mode)
        np.testing.assert_array_equal(load_map(tmp_path / mode).cells, grid.cells)


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(),
    st.floats(0.0, 0.49),
    st.floats(0.5, 1.0),
)
def test_every_grey_value_is_read_as_by_map_server(
    tmp_path_factory: pytest.TempPathFactory, mode: str, negate: bool, low: float, high: float
) -> None:
    """Against the rules of map_server and nav2_map_server, written out for one pixel at a time."""

    def rule(pixel: int) -> int:
        if mode == "raw":
            return pixel if pixel <= 100 else -1
        occupancy = pixel / 255 if negate else (255 - pixel) / 255
        if occupancy > high:
            return 100
        if occupancy < low:
            return 0
        return -1 if mode == "trinary" else round((occupancy - low) / (high - low) * 100)

    folder = tmp_path_factory.mktemp("shades")
    pixels = np.arange(256, dtype=np.uint8)[None]
    write_map(folder, pixels, mode=mode, negate=int(negate), free_thresh=low, occupied_thresh=high)
    cells = load_map(folder).cells[0].tolist()
    expected = [rule(pixel) for pixel in range(256)]
    assert max(abs(a - b) for a, b in zip(cells, expected, strict=True)) <= (mode == "scale"), (
        "a half may round either way"
    )
    assert sum(a != b for a, b in zip(cells, expected, strict=True)) <= 3


def test_the_first_row_of_the_image_is_the_top(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.array([[0, 254], [254, 254], [205, 254]], np.uint8))
    np.testing.assert_array_equal(load_map(folder).cells, [[-1, 0], [0, 0], [100, 0]])


def test_negate_makes_bright_pixels_occupied(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.array([[255, 0, 128]], np.uint8), negate=1)
    np.testing.assert_array_equal(load_map(folder).cells, [[100, 0, -1]])


def test_the_mode_scale_spreads_the_values_between_the_thresholds(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.array([[0, 89, 102, 153, 204, 255]], np.uint8), mode="scale", free_thresh=0.2)
    expected = [100, 100, round((0.6 - 0.2) / 0.45 * 100), round((0.4 - 0.2) / 0.45 * 100), 0, 0]
    np.testing.assert_array_equal(load_map(folder).cells, [expected])


def test_transparent_pixels_are_unknown_and_opaque_ones_unchanged(tmp_path: Path) -> None:
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 255], [0, 0, 0, 0]]], np.uint8)
    grey = np.array([[[205, 205, 205, 255], [100, 100, 100, 255], [254, 254, 254, 255]]], np.uint8)
    folder = write_map(tmp_path, pixels, "map.png", mode="scale")
    np.testing.assert_array_equal(load_map(folder).cells, [[100, -1, 0, -1]])
    folder = write_map(tmp_path, pixels, "map.png")
    np.testing.assert_array_equal(load_map(folder).cells, [[100, -1, 0, -1]])
    with_alpha = load_map(write_map(tmp_path, grey, "map.png")).cells
    np.testing.assert_array_equal(with_alpha, load_map(write_map(tmp_path, grey[..., :3], "map.png")).cells)
    np.testing.assert_array_equal(with_alpha, [[-1, -1, 0]])


def test_the_mode_raw_takes_pixels_as_values_and_above_100_as_unknown(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.array([[0, 1, 99, 100, 101, 255]], np.uint8), mode="raw")
    np.testing.assert_array_equal(load_map(folder).cells, [[0, 1, 99, 100, -1, -1]])


@pytest.mark.parametrize("image", ["map.png", "map.bmp", "map.pgm"])
def test_colour_and_grey_images_of_any_kind_give_the_same_map(tmp_path: Path, image: str) -> None:
    pixels = np.array([[0, 254], [205, 254]], np.uint8)
    grey = load_map(write_map(tmp_path, pixels, image)).cells
    if image != "map.pgm":
        colour = load_map(write_map(tmp_path, np.repeat(pixels[..., None], 3, axis=2), image)).cells
        np.testing.assert_array_equal(colour, grey)
    np.testing.assert_array_equal(grey, [[-1, 0], [100, 0]])


def test_sixteen_bit_images_are_scaled_by_their_own_white(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.array([[0, 65535, 205 * 257]], np.uint16), "map.png", free_thresh=0.196)
    np.testing.assert_array_equal(load_map(folder).cells, [[100, 0, -1]])


def test_a_text_pgm_with_comments_is_read(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.zeros((1, 1), np.uint8))
    (folder / "map.pgm").write_text("P2\n# made by hand\n3 1\n# white\n255\n0 254 205\n")
    np.testing.assert_array_equal(load_map(folder).cells, [[100, 0, -1]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"resolution": ...}, "lacks resolution; add it"),
        ({"image": None, "origin": ...}, "lacks image, origin; add them"),
        ({"free_thresh": ...}, "lacks free_thresh"),
        ({"resolution": 0.0}, "resolution is 0.0"),
        ({"resolution": -0.05}, "resolution is -0.05"),
        ({"resolution": float("nan")}, "resolution is nan"),
        ({"resolution": "fine"}, "resolution is 'fine'; it must be a number"),
        ({"resolution": [1]}, "must be a number"),
        ({"resolution": True}, "resolution is True; it must be a number"),
        ({"origin": [0.0, 0.0, False]}, r"must be \[x, y, yaw\]"),
        ({"origin": [1.0, 2.0]}, r"must be \[x, y, yaw\]"),
        ({"origin": [10**400, 0.0, 0.0]}, "line 6: '1000.* is not a valid value"),
        ({"resolution": 10**400}, "is not a valid value"),
        ({"origin": [1e19, 0.0, 0.0]}, r"may be up to 1e\+06 m"),
        ({"origin": [0.0, 0.0, 90]}, r"radians, at most a full turn \(90 degrees are 1\.571\)"),
        ({"origin": 3}, r"must be \[x, y, yaw\]"),
        ({"origin": [0.0, float("inf"), 0.0]}, "up to 1e"),
        ({"mode": "colour"}, "one of trinary, scale, raw"),
        ({"mode": ["raw"]}, "one of trinary, scale, raw"),
        ({"free_thresh": 0.7}, "must be less than occupied_thresh"),
        ({"occupied_thresh": 65}, "occupied_thresh is 65.0"),
        ({"negate": 2}, "negate is 2.0"),
    ],
)
def test_an_impossible_yaml_is_refused_with_its_key(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    folder = write_map(tmp_path, np.zeros((2, 2), np.uint8))
    values = {key: value for key, value in {**GOOD, **changes}.items() if value is not ...}
    (folder / "map.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(MapError, match=message):
        load_map(folder)


@pytest.mark.parametrize("text", ["", "just words", "a: [1", "- 1\n- 2\n", "a: 2024-99-99\n", "[" * 3000])
def test_a_yaml_without_a_map_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapError) as caught:
        load_map(tmp_path)
    assert "\n" not in str(caught.value)


def test_an_image_given_as_the_map_is_refused_with_advice(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.full((4, 4), 205, np.uint8))
    with pytest.raises(MapError):
        load_map(folder / "map.pgm")


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(MapNotFound, match=r"there is no map at .*map\.yaml"):
        load_map(tmp_path)
    with pytest.raises(MapNotFound):
        load_map(tmp_path / "nowhere")
    folder = write_map(tmp_path, np.zeros((2, 2), np.uint8))
    (folder / "map.pgm").unlink()
    with pytest.raises(MapNotFound, match=r"map\.pgm is not there"):
        load_map(folder)


def test_an_image_truncated_anywhere_is_refused_without_warnings(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    save_map(tmp_path, OccupancyGrid(np.zeros((9, 7), np.int8), 0.05))
    data = (tmp_path / "map.pgm").read_bytes()
    for end in range(len(data)):
        (tmp_path / "map.pgm").write_bytes(data[:end])
        with pytest.raises(MapError, match="cut short"):
            load_map(tmp_path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (b"P5\n3 2\n255\n" + bytes(7), "goes on after the 6 values"),
        (b"P5 3 2 65535\n" + bytes(6), "cut short: it holds 3 of the 6 values"),
        (b"P5\n# wide\n4 2\n255\n" + bytes(6), "cut short: it holds 6 of the 8"),
        (b"P2\n3 2\n255\n" + b"254 " * 5, "cut short: it holds 5 of the 6"),
        (b"P2\n3 2\n255\n" + b"254 " * 7, "goes on after the 6"),
        (b"P6\n1 2\n255\n" + bytes(5), "cut short: it holds 5 of the 6"),
    ],
)
def test_an_image_of_another_size_than_its_header_says_is_refused(tmp_path: Path, image: bytes, said: str) -> None:
    folder = write_map(tmp_path, np.zeros((1, 1), np.uint8))
    (folder / "map.pgm").write_bytes(image)
    with pytest.raises(MapError, match=said):
        load_map(folder)


def test_an_image_with_a_final_line_end_or_comments_is_read(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.zeros((1, 1), np.uint8))
    for image in (b"P5\n3 1\n255\n\x00\xfe\xcd\n", b"P5\n3 1\n65535\n\x00\x00\xff\xff\xcd\xcd\r\n"):
        (folder / "map.pgm").write_bytes(image)
        np.testing.assert_array_equal(load_map(folder).cells, [[100, 0, -1]])


def png_header(width: int, height: int) -> bytes:
    return b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + width.to_bytes(4, "big") + height.to_bytes(4, "big")


@pytest.mark.parametrize(
    "image",
    [
        png_header(21_000, 21_000),
        b"P5\n20001 20001\n255\n",
        b"P2 999999999 999999999 255\n",
        b"BM" + bytes(16) + (30_000).to_bytes(4, "little") + (-30_000).to_bytes(4, "little", signed=True),
    ],
)
def test_an_image_with_too_many_cells_is_refused_before_it_is_decoded(tmp_path: Path, image: bytes) -> None:
    folder = write_map(tmp_path, np.zeros((1, 1), np.uint8))
    (folder / "map.pgm").write_bytes(image)
    with pytest.raises(MapError, match="save it with larger cells"):
        load_map(folder)


def test_a_map_of_4000_by_4000_cells_is_read(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.full((4000, 4000), 254, np.uint8))
    assert load_map(folder).cells.shape == (4000, 4000)


def test_impossible_file_names_are_named(tmp_path: Path) -> None:
    for name in ("a" * 400, "a\0b"):
        folder = write_map(tmp_path, np.zeros((2, 2), np.uint8))
        with pytest.raises(MapNotFound):
            load_map(tmp_path / name)
        (folder / "map.yaml").write_text(yaml.safe_dump({**GOOD, "image": name}))
        with pytest.raises(MapNotFound):
            load_map(folder)


def test_a_key_that_is_given_twice_is_refused(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.zeros((2, 2), np.uint8))
    (folder / "map.yaml").write_text((folder / "map.yaml").read_text() + "resolution: 0.5\n")
    with pytest.raises(MapError, match="'resolution' is given twice"):
        load_map(folder)


def test_an_image_of_floats_is_refused(tmp_path: Path) -> None:
    folder = write_map(tmp_path, np.zeros((2, 2), np.float32), "map.tiff")
    with pytest.raises(MapError, match="is a TIFF file; save it as PNG"):
        load_map(folder)


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        save_map(tmp_path / "file" / "map", OccupancyGrid(np.zeros((2, 2), np.int8), 0.05))
