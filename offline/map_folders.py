"""Operations on whole map folders: copying, and refusing to mix files of two maps."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import yaml

from waychair import config
from waychair.config import Settings
from waychair.errors import ConfigError, MapError, OutputError, RecordingError
from waychair.files import is_file, path_exists, read_bytes, read_text, remove, replacing, write_text
from waychair.maps.drawn.anchors import GRAPH
from waychair.maps.folders.depth_layer import DEPTH
from waychair.maps.folders.map_drawing import DRAWN_FILES, DrawingEditor, forget, is_drawn_on
from waychair.maps.folders.map_files import MAP_YAML, load_info, load_map, yaml_path
from waychair.offline.memory_file import MEMORY
from waychair.offline.sessions import SESSION
from waychair.recordings.recording import read_tum
from waychair.types import SensorFrame
from waychair.yaml_files import load_yaml

CONFIG, TRAJECTORY, REPORT = "config.yaml", "trajectory.tum", "report.json"

_OTHERS = (f"{DEPTH}.pgm", f"{DEPTH}.yaml", GRAPH, SESSION, MEMORY, TRAJECTORY, CONFIG, REPORT, "report.html")
"""Files of a map other than its YAML, its image, and the places and zones."""


def refuse_drawn(folder: Path, instead: str = "choose another folder") -> None:
    """Refuse a folder with places, zones or erased parts for a new map; `instead` is the advice in the error.

    Raises:
        OutputError: the folder holds some.
        MapError: the folder cannot be read.
    """
    if is_drawn_on(folder):
        raise OutputError(f"the places, zones or erased parts in {folder} are those of another map: {instead}")
    forget(folder)


def refuse_other(folder: Path, frames: Sequence[SensorFrame], settings: Settings) -> None:
    """As `refuse_drawn`, but allow the map of the same recording with the same settings to be made again.

    Raises:
        OutputError: the folder holds another map with places, zones or erased parts.
        MapError: the folder cannot be read.
    """
    if not _is_made_of(folder, frames, settings):
        refuse_drawn(folder, "choose another folder with --out, or join the drive to that map with --session")


def set_aside(folder: Path) -> Path | None:
    """Rename a folder with places, zones or erased parts; return its new path, None where it has none.

    Raises:
        OutputError: the folder cannot be renamed.
        MapError: the folder cannot be read.
    """
    if not is_drawn_on(folder):
        return None
    aside = next(
        path for n in itertools.count(1) if not path_exists(path := folder.with_name(f"{folder.name}-{n}"), MapError)
    )
    try:
        folder.rename(aside)
    except OSError as error:
        raise OutputError(f"cannot rename {folder}, which is in the way: {error.strerror}; move it yourself") from error
    return aside


def copy_map(map: Path, folder: Path) -> None:
    """Copy the map of a folder or YAML file with all its files, places and zones; map.yaml is written last.

    An existing copy of the same map gets the present places and zones only, as a change that can be undone
    (`maps.folders.map_drawing`).

    Raises:
        OutputError: the folder cannot be written to, or holds another map with places, zones or erased parts.
        WaychairError: a file of the map is broken.
    """
    known = yaml_path(map)
    if (folder / MAP_YAML).resolve() == known.resolve():
        return
    load_map(known, lambda _: None)
    if _has_image_of(folder, known):
        DrawingEditor(folder).draw(DrawingEditor(known).drawing)
        return
    refuse_drawn(folder)
    for name in (*DRAWN_FILES, *_OTHERS):
        _copy(known.with_name(name), folder / name)
    info, values = load_info(known), load_yaml(known, MapError)
    image = f"map{info.image.suffix}"
    _copy(info.image, folder / image)
    write_text(folder / MAP_YAML, yaml.safe_dump({**values, "image": image}, sort_keys=False, default_flow_style=None))


def _copy(source: Path, target: Path) -> None:
    """Copy a file; without a source remove the target, which belonged to another map."""
    if not is_file(source, MapError):
        remove(target)
        return
    with replacing(target) as aside:
        shutil.copyfile(source, aside)


def _has_image_of(folder: Path, known: Path) -> bool:
    """Whether a folder holds a map with the same grid as a YAML file's."""
    if not is_file(folder / MAP_YAML, MapError):
        return False
    try:
        one, other = load_info(folder / MAP_YAML), load_info(known)
        alike = replace(one, image=other.image) == other
        return alike and read_bytes(one.image, MapError) == read_bytes(other.image, MapError)
    except MapError:  # the map in the folder is broken
        return False


def _is_made_of(folder: Path, frames: Sequence[SensorFrame], settings: Settings) -> bool:
    """Whether the folder's map was made from these frames alone, with these settings."""
    paths = [folder / name for name in (CONFIG, TRAJECTORY, REPORT)]
    if not frames or not all(is_file(path, MapError) for path in paths):
        return False
    try:
        stamps = read_tum(folder / TRAJECTORY).stamps_ns
        same = read_text(folder / CONFIG, MapError) == config.dump(settings)
        joined = '"session"' in read_text(folder / REPORT, MapError)
    except (ConfigError, RecordingError, MapError):
        return False
    mine = {frame.stamp_ns for frame in frames}
    return same and not joined and len(stamps) > 0 and {int(stamps[0]), int(stamps[-1])} <= mine
