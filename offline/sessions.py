"""Multi-session mapping: several drives through one building, on different days, become one map.

The data from which a map is drawn are saved beside it (`session.npz`): the graph of key scans, with the scans and depth
images anchored to them. A further drive continues that graph. While its start on the map is unknown, its key scans form
a graph of their own; the first accepted loop closure, by pictures and scans or by scans alone, joins the two. Then the
drive is mapped again from its beginning with that start known. Known ground is then covered by existing key scans, and
the graph grows only where the drive saw new ground.

A key scan whose surroundings have changed is renewed by the latest scan that it covered. `maps.layers.session_grid` forgets
things that were moved away.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.errors import OutputError, SessionError
from waychair.files import replacing
from waychair.maps.depth.depth_scan import DepthScan
from waychair.slam.mapping.checkpoint import object_from_state, state_of
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.mapping.mapper import Mapper
from waychair.slam.mapping.renewed_surfaces import renewed_surfaces
from waychair.types import FloatArray, OccupancyGrid, Pose2, Pose3, Scan

SESSION = "session.npz"
"""Name of the session's file in a map folder."""

_MOUNT, _MOUNT_TURN = 0.05, math.radians(3.0)  # [m], [rad] greatest difference between mounts of one chair


@dataclass(frozen=True, slots=True)
class KeptScan:
    """A scan of the grid: its session, its key scan, and the lidar's poses (2, 3) from there at first and last beam."""

    session: int
    scan: Scan
    key: int
    key_from_laser: FloatArray


@dataclass(frozen=True, slots=True)
class KeptPicture:
    """A depth image of the grid: its session, its depth scan, its key scan, and the chair's pose (3,) from there."""

    session: int
    told: DepthScan
    key: int
    key_from_base: FloatArray


@dataclass(frozen=True, slots=True)
class MapState:
    """The state from which a further drive continues. `scans` are those of the mapper's frames, in order."""

    mapper: Mapper
    sessions: int
    laser_height: float
    base_from_camera: tuple[FloatArray, FloatArray] | None
    features: str
    scans: tuple[KeptScan, ...]
    pictures: tuple[KeptPicture, ...]


def state_of_map(live: LiveMapping, base_from_camera: Pose3 | None, features: str) -> MapState:
    """Return the state of a settled mapping; `features` names the pictures' feature detector."""
    mapper = live.mapper
    numbers = sorted(mapper.key_frames + [frame for latest in mapper.covered_frames for frame in latest])
    scans = [KeptScan(*live.scans.attached(number)) for number in numbers]
    of_frame = {
        number: (kept.scan, Pose2(*kept.key_from_laser[0].tolist()))
        for number, kept in zip(numbers, scans, strict=True)
    }
    pictures = tuple(KeptPicture(*hung) for hung in live.depth.kept_images())
    camera = None if base_from_camera is None else (base_from_camera.rotation, base_from_camera.translation)
    return MapState(
        mapper=mapper.for_next_drive(renewed_surfaces(mapper, of_frame)),
        sessions=live.scans.session + 1,
        laser_height=live.settings.laser_height,
        base_from_camera=camera,
        features=features,
        scans=tuple(scans),
        pictures=pictures,
    )


def save_state(folder: Path, state: MapState) -> None:
    """Write a state to a map folder.

    Raises:
        OutputError: the file cannot be written.
    """
    with replacing(folder / SESSION) as aside, aside.open("wb") as file:
        np.savez(file, **state_of(state))  # type: ignore[arg-type]


def session_folder(map: Path) -> Path:
    """Return the folder of a map that is given by its folder or its map.yaml.

    Raises:
        SessionError: there is no such folder.
    """
    folder = map.parent if map.name == "map.yaml" else map
    if not folder.is_dir():
        raise SessionError(f"there is no map folder {folder} to join the drive to: give that of an earlier drive's map")
    return folder


def load_state(folder: Path) -> MapState:
    """Read the state of a map folder.

    Raises:
        SessionError: there is none, or it is damaged or of another version.
    """
    path = folder / SESSION
    try:
        with np.load(path, allow_pickle=False) as state:
            return object_from_state(state, MapState)
    except FileNotFoundError as error:
        raise SessionError(f"{folder} holds no {SESSION} to go on from: map its recording again to get one") from error
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise SessionError(f"{path} is damaged or of another version ({error}): map its recording again") from error


def check_sensors(
    state: MapState,
    base_from_laser: Pose2,
    settings: LiveMappingSettings,
    base_from_camera: Pose3 | None,
    features: str,
) -> None:
    """Compare the sensors of a drive with those of a map.

    Raises:
        SessionError: they are mounted differently, or use another feature detector.
    """
    gap = state.mapper.base_from_laser.inverse() @ base_from_laser
    height = settings.laser_height - state.laser_height
    if math.hypot(gap.x, gap.y, height) > _MOUNT or abs(gap.theta) > _MOUNT_TURN:
        then, now = (
            "({:.2f} m, {:.2f} m, {:.2f} rad) at {:.2f} m".format(*pose.array(), up)
            for pose, up in (
                (state.mapper.base_from_laser, state.laser_height),
                (base_from_laser, settings.laser_height),
            )
        )
        raise SessionError(f"the map was made with the laser {then}, this drive has it {now}: map it by itself")
    if state.base_from_camera is None or base_from_camera is None:
        return
    rotation, translation = state.base_from_camera
    moved = float(np.linalg.norm(base_from_camera.translation - translation))
    turned = math.acos(min(1.0, max(-1.0, (float(np.trace(rotation.T @ base_from_camera.rotation)) - 1.0) / 2.0)))
    if moved > _MOUNT or turned > _MOUNT_TURN:
        raise SessionError(
            f"the map's camera was mounted elsewhere, by {moved:.2f} m and {turned:.2f} rad: map the drive by itself"
        )
    if state.features != features:
        raise SessionError(
            f"the map was made with {state.features} features, this drive with {features}: set the detector in --config"
        )


def continue_map(live: LiveMapping, state: MapState) -> OccupancyGrid:
    """Let a new mapping continue an earlier map; return the grid of its scans. The mapping takes over the state."""
    live.continue_map(state.mapper, state.sessions)
    for number, kept in enumerate(state.scans):
        live.scans.begin(kept.session)
        first, last = kept.key_from_laser
        live.scans.add(number, kept.scan, kept.key, first, last)
    live.scans.begin(state.sessions)
    for picture in state.pictures:
        live.depth.assembly.begin(picture.session)
        live.depth.anchor(picture.told, picture.key, picture.key_from_base)
    live.depth.assembly.begin(state.sessions)
    for assembly in (live.scans, live.depth.assembly):
        assembly.move_nodes(live.mapper.keys.poses, np.zeros(2))
    live.draw_all()
    return live.scans.grid()


@contextmanager
def replaced_folder(folder: Path, like: Path) -> Iterator[Path]:
    """Yield a copy of `like` that replaces `folder` when the block ends without an error, and is removed otherwise.

    So a failed join leaves the existing map as it was.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = folder.absolute()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as work:
            aside = Path(work) / "new"
            shutil.copytree(like, aside)
            yield aside
            if folder.exists():
                before = Path(work) / "before"
                folder.rename(before)
                try:
                    aside.rename(folder)
                except OSError:
                    before.rename(folder)
                    raise
            else:
                aside.rename(folder)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}; choose another folder") from error
