"""The files that a user gives, or the folders that hold them, as one recording of a known kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from waychair.errors import RecordingDamaged, RecordingError, RecordingNotFound, RecordingUnknown
from waychair.recordings.bags.bag_parts import BagFiles, bag_files, bag_kind, bags_in, files_in, is_ros2_folder
from waychair.recordings.other_files import is_text, likely_kind, other_kind
from waychair.recordings.packed import packing_of, unpacked_head
from waychair.recordings.rgbd_folders import is_rgbd_folder
from waychair.recordings.text.carmen import is_carmen
from waychair.recordings.text.coreslam import is_coreslam
from waychair.recordings.text.laser_text import is_laser_text

_HEAD = 1 << 16  # bytes; the first data line of a text file lies within them
_MOST_NAMED = 5  # files or folders that a message names

_NOTES = ("", ".md", ".txt", ".rst", ".py")  # endings of files that accompany others

_KINDS = (
    "give a .clf, .log, .dat, .bag, .mcap or .db3 file, the folder of a ROS 2 bag, or a folder of pictures, which lie in "
    "rgb/ and depth/ or are named frame-N.color.png and frame-N.depth.png"
)


@dataclass(frozen=True, slots=True)
class RecordingFiles:
    """One recording: the files of a bag, or else a folder of pictures or a text log at `path`.

    `parts` are the files and folders that were given or found, `warnings` tell of those that were left out.
    """

    path: Path
    parts: tuple[Path, ...]
    pictures: bool = False
    bag: BagFiles | None = None
    warnings: tuple[str, ...] = ()


def find_recording(paths: Sequence[Path]) -> RecordingFiles:
    """Return the recording that the paths are: one file or folder, or the parts of one bag.

    A folder may hold a bag's parts, or one recording one level down.

    Raises:
        RecordingNotFound: a path does not exist.
        RecordingUnknown: a file is of another kind than recordings.
        RecordingDamaged: a file is empty, or a folder holds no recording.
        RecordingError: a file cannot be opened, or the files are no parts of one recording.
    """
    for path in paths:
        _check(path)
    warnings: list[str] = []
    found = [each for path in paths for each in _resolved(path, warnings)]
    name = paths[0] if len(paths) == 1 else paths[0].with_name(f"{paths[0].name} and {len(paths) - 1} more")
    name = found[0] if len(found) == 1 else name
    if len(found) == 1 and is_rgbd_folder(found[0]):
        return RecordingFiles(found[0], tuple(found), pictures=True, warnings=tuple(warnings))
    if len(found) == 1 and not _is_bag(found[0]):
        return RecordingFiles(found[0], tuple(found), warnings=tuple(warnings))
    for each in found:
        if not _is_bag(each):
            kind = "a folder of pictures" if is_rgbd_folder(each) else "a text log"
            raise RecordingError(
                f"{each} is {kind} and can only be given alone: only bags can be parts of one recording; map it first and "
                "join further drives with --session"
            )
    bag = bag_files(name, found, chosen=len(paths) > 1)
    return RecordingFiles(name, tuple(found), bag=bag, warnings=(*warnings, *bag.warnings))


def pictures_folder(paths: Sequence[Path]) -> bool:
    """Return whether the paths are one folder of pictures, or a folder that only holds one."""
    if len(paths) != 1 or not paths[0].is_dir():
        return False
    return is_rgbd_folder(paths[0]) or (
        not _recordings_in(paths[0]) and [is_rgbd_folder(each) for each in _one_level_down(paths[0])] == [True]
    )


def text_head(path: Path) -> bytes:
    """Return the beginning of a file, decompressed."""
    head = _head(path)
    packing = packing_of(head)
    return head if packing is None else unpacked_head(path, packing, _HEAD)


def _resolved(path: Path, warnings: list[str]) -> list[Path]:
    """Return the recording of a path, or the parts of a bag in a folder."""
    if path.is_file() and path.name == "metadata.yaml" and bags_in(path.parent):
        warnings.append(f"{path} is the description of a ROS 2 bag: its folder was read")
        path = path.parent
    if not path.is_dir():
        _refuse_other(path)
        return [path]
    if is_rgbd_folder(path) or is_ros2_folder(path):
        return [path]
    found = _recordings_in(path)
    if found and all(map(_is_bag, found)):
        if any((kind := bag_kind(each)) is not None and kind[0] != ".bag" for each in found):
            warnings.append(f"{path} has no metadata.yaml of a ROS 2 bag: all of its .mcap and .db3 files were read")
        return found
    below = _one_level_down(path)
    if len(found) + len(below) == 1:
        (only,) = *found, *below
        warnings.append(f"{path} is no recording, but holds one: {only.name} was read")
        return _resolved(only, warnings)
    if found or below:
        raise RecordingError(f"{path} holds {_listed([*found, *below])}: give one of them, or the parts of one bag")
    raise RecordingDamaged(f"{path} is not a recording: {_content(path)}; {_KINDS}")


def _recordings_in(folder: Path) -> list[Path]:
    """Return the bags in a folder, else its text logs."""
    bags = bags_in(folder)
    return bags or [file for file in files_in(folder) if _looks_like_log(file)]


def _one_level_down(folder: Path) -> list[Path]:
    """Return the folders in a folder that are or hold a recording."""
    folders = sorted(each for each in folder.iterdir() if each.is_dir() and not each.name.startswith("."))
    return [each for each in folders if is_rgbd_folder(each) or is_ros2_folder(each) or _recordings_in(each)]


def _looks_like_log(file: Path) -> bool:
    head = text_head(file)
    lines = [line for line in head.split(b"\n") if line.strip() and not line.startswith(b"#")]
    return (
        bool(lines) and is_text(head) and any(is_kind(lines[0]) for is_kind in (is_carmen, is_coreslam, is_laser_text))
    )


def _refuse_other(file: Path) -> None:
    """Refuse a file of another kind.

    Raises:
        RecordingUnknown: the file is of another kind; the sentence names it.
    """
    head = _head(file)
    kind = other_kind(file, head)
    if kind is None and (packing := packing_of(head)) is not None:
        head = unpacked_head(file, packing, _HEAD)
        inner = other_kind(file, head) if not head.startswith((b"SQLite", b"\x89MCAP", b"PK")) else None
        if inner is not None:
            raise RecordingUnknown(f"{file} is {inner.name}, packed by {packing.name}: {inner.advice}")
    if kind is None and head and bag_kind(file) is None and not is_text(head):
        kind = likely_kind(file, head)
        if kind is None:
            raise RecordingUnknown(f"{file} is neither a text log nor a bag: {_KINDS}")
    if kind is not None:
        raise RecordingUnknown(kind.sentence(file))


def _check(path: Path) -> None:
    if not path.exists():
        raise RecordingNotFound(f"there is no recording at {path}; check the path")
    if path.is_file() and not _head(path):
        raise RecordingDamaged(f"{path} is empty; copy it again from its source")


def _is_bag(path: Path) -> bool:
    return is_ros2_folder(path) if path.is_dir() else bag_kind(path) is not None


def _content(folder: Path) -> str:
    """Return the content of a folder without a recording, as part of a sentence."""
    files = files_in(folder)
    for file in files:
        kind = other_kind(file, head := text_head(file))
        if kind is None and file.suffix.lower() not in _NOTES:
            kind = likely_kind(file, head)
        if kind is not None:
            more = f", and {len(files) - 1} other files" if len(files) > 1 else ""
            return f"it holds {file.name}, {kind.name}{more}"
    if files:
        return f"it holds {_listed(files)}, and no metadata.yaml, .mcap or .db3 of a ROS 2 bag"
    return "it has no metadata.yaml, .mcap or .db3 of a ROS 2 bag, no other bags and no logs"


def _listed(paths: Sequence[Path]) -> str:
    names = ", ".join(path.name for path in paths[:_MOST_NAMED])
    return names + (f" and {len(paths) - _MOST_NAMED} more" if len(paths) > _MOST_NAMED else "")


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
