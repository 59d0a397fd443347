"""The files of one bag: parts of a split recording, folders of them, and compressed ones.

`rosbag record --split` and `ros2 bag record` write a drive as several files; two recorders may also write different
topics at the same time. Such files are one recording. Files of several drives are not.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import islice, pairwise
from pathlib import Path

from waychair.errors import RecordingDamaged, RecordingError, RecordingUnknown
from waychair.recordings.other_files import other_kind
from waychair.recordings.packed import PACKED_ENDINGS, Packing, packing_of, unpack, unpacked_head

SUFFIXES = {b"#ROSBAG V2.0": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3": ".db3"}
"""The suffix of each kind of bag file, by its magic bytes."""

LONGEST_PAUSE = 60.0
"""[s] Files in one folder that are further apart in time are drives of their own: no recorder pauses that long."""

TOLD_PAUSE = 3.0
"""[s] A longer pause between two parts is told: a part may be missing."""

MOST_OVERLAP = 1.0
"""[s] Parts with the same sensor topics that overlap longer are no parts of one recording."""

_MOST_LOOKED_AT = 5000  # files of a folder; a recording of more files is one of pictures
_PART = re.compile(r"(.*_)(\d+)(\.[a-z0-9]+)", re.IGNORECASE)
_MOST_PARTS = 500  # a greater number at the end of a name is a date or a time
_HEAD = 512  # bytes that tell the kind of a file
_SENSORS = ("LaserScan", "PointCloud2", "Odometry", "Imu", "Image", "CompressedImage", "MultiEchoLaserScan")


@dataclass(frozen=True, slots=True)
class BagFiles:
    """The files of one bag, each with its kind: .bag, .mcap, .db3, or '' for the folder of a ROS 2 bag.

    `path` names the bag in messages. Compressed files were unpacked into a folder that lives as long as this object.
    """

    path: Path
    members: tuple[tuple[Path, str], ...]
    warnings: tuple[str, ...] = ()
    room: tempfile.TemporaryDirectory[str] | None = field(default=None, compare=False, repr=False)

    @property
    def is2(self) -> bool:
        """Return whether these are files of a ROS 2 bag."""
        return any(kind != ".bag" for _, kind in self.members)


@dataclass(frozen=True, slots=True)
class _Span:
    """The times of the first and last message of a file [ns], its sensor topics, and its number of messages."""

    file: Path
    start: int
    end: int
    topics: frozenset[tuple[str, str]]
    count: int


def bag_suffix(head: bytes) -> str | None:
    """Return `.bag`, `.mcap` or `.db3` by the first bytes of a file; None for anything else."""
    return next((suffix for magic, suffix in SUFFIXES.items() if head.startswith(magic)), None)


def bag_kind(file: Path) -> tuple[str, Packing | None] | None:
    """Return the kind of a bag file and its compression; None for a file that is no bag."""
    head = _head(file)
    packing = packing_of(head)
    kind = bag_suffix(head if packing is None else unpacked_head(file, packing, 64))
    if kind is None or (packing is None and other_kind(file, head) is not None):
        return None
    return kind, packing


def is_ros2_folder(folder: Path) -> bool:
    """Return whether a folder has the metadata.yaml of a ROS 2 bag, even a damaged one."""
    return (folder / "metadata.yaml").is_file()


def bags_in(folder: Path) -> list[Path]:
    """Return the bag files in a folder by name, without the copies that rosbag and compression leave beside them."""
    bags = [file for file in files_in(folder) if bag_kind(file) is not None]
    names = {file.name for file in bags}
    return [file for file in bags if not _is_copy(file.name, names)]


def files_in(folder: Path) -> list[Path]:
    """Return the files in a folder by name, without hidden ones; of a great many, the first in its list."""
    files = (file for file in folder.iterdir() if not file.name.startswith(".") and file.is_file())
    return sorted(islice(files, _MOST_LOOKED_AT))


def bag_files(path: Path, files: Sequence[Path], *, chosen: bool) -> BagFiles:
    """Return the files as one bag, compressed ones unpacked.

    Args:
        path: the name of the bag in messages.
        files: bag files and folders of ROS 2 bags.
        chosen: whether the user has named each file; then pauses between them are told, and not refused.

    Raises:
        RecordingError: the files are of ROS 1 and ROS 2, overlap in time, or are drives of their own.
        RecordingDamaged: a compressed file cannot be unpacked at all.
        RecordingUnknown: a file is no bag.
    """
    members: list[tuple[Path, str]] = []
    warnings: list[str] = []
    room: tempfile.TemporaryDirectory[str] | None = None
    for file in dict.fromkeys(files):
        if file.is_dir():
            members.append((file, ""))
            continue
        found = bag_kind(file)
        if found is None:
            kind = other_kind(file, _head(file))
            raise RecordingUnknown(
                kind.sentence(file) if kind else f"{file} is no bag: give the bags of one drive only"
            )
        kind_of, packing = found
        if packing is not None:
            room = room or tempfile.TemporaryDirectory(prefix="waychair-")
            target = Path(room.name) / f"{len(members)}-{_without_packing(file.name)}"
            reason = unpack(file, packing, target)
            if reason:
                warnings.append(f"{file} is cut short or damaged ({reason}): only the data before that were unpacked")
            file = target
        members.append((file, kind_of))
    if {kind == ".bag" for _, kind in members} == {True, False}:
        one = next(file for file, kind in members if kind == ".bag")
        other = next(file for file, kind in members if kind != ".bag")
        raise RecordingError(f"{one.name} is a bag of ROS 1 and {other.name} of ROS 2: give the files of one bag")
    if len(members) > 1:
        members, told = _in_order(path, members, chosen)
        warnings += told if chosen else [*told, *_missing_parts(path, files)]
    return BagFiles(path, tuple(members), tuple(warnings), room)


def _in_order(path: Path, members: list[tuple[Path, str]], chosen: bool) -> tuple[list[tuple[Path, str]], list[str]]:
    """Return the parts by time without copies, and warnings about copies and pauses."""
    spans = [_span(file, kind) for file, kind in members]
    known = sorted((span for span in spans if span is not None), key=lambda span: (span.start, span.end))
    warnings, kept = [], known[:1]
    for span in known[1:]:
        before = kept[-1]
        if (span.start, span.end, span.count, span.topics) == (before.start, before.end, before.count, before.topics):
            warnings.append(f"{span.file.name} is a copy of {before.file.name} and is left out")
        else:
            kept.append(span)
    _refuse_overlap(kept)
    warnings += _pauses(path, kept, chosen)
    if len(known) == len(spans):
        kinds = dict(members)
        return [(span.file, kinds[span.file]) for span in kept], warnings
    # A damaged file has no times; its name, which counts the parts, tells its place.
    copies = {span.file for span in known} - {span.file for span in kept}
    return [member for member in members if member[0] not in copies], warnings


def _span(file: Path, kind: str) -> _Span | None:
    """Return the times and topics of a part; None for a damaged one or one without messages."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    link = file
    with tempfile.TemporaryDirectory() as work, suppress(Exception):  # damaged bytes raise many kinds of errors
        if kind and file.suffix != kind:
            link = Path(work) / f"bag{kind}"
            link.symlink_to(file.resolve())
        reader = Reader1(link) if kind == ".bag" else Reader2(link)
        with reader:
            topics = frozenset(
                (c.topic, c.msgtype) for c in reader.connections if c.msgtype.rpartition("/")[2] in _SENSORS
            )
            if reader.message_count:
                return _Span(file, reader.start_time, reader.end_time, topics, reader.message_count)
    return None


def _refuse_overlap(spans: Sequence[_Span]) -> None:
    for k, one in enumerate(spans):
        for other in spans[k + 1 :]:
            both = sorted(topic for topic, _ in one.topics & other.topics)
            seconds = (min(one.end, other.end) - other.start) * 1e-9
            if both and seconds > MOST_OVERLAP:
                raise RecordingError(
                    f"{one.file.name} and {other.file.name} both hold {both[0]} for the same {seconds:.0f} s: they are not "
                    "parts of one recording; give one of them"
                )


def _pauses(path: Path, spans: Sequence[_Span], chosen: bool) -> list[str]:
    """Return warnings about the pauses between parts.

    Raises:
        RecordingError: a folder holds several drives.
    """
    groups: list[list[_Span]] = [list(spans[:1])]
    warnings = []
    for before, span in pairwise(spans):
        seconds = (span.start - max(each.end for each in spans if each.start <= before.start)) * 1e-9
        if seconds > LONGEST_PAUSE:
            groups.append([])
        elif seconds > TOLD_PAUSE:
            warnings.append(_pause(seconds, before, span) + "is a part missing?")
        groups[-1].append(span)
        if seconds > LONGEST_PAUSE and chosen:
            warnings.append(
                _pause(seconds, before, span) + "if the chair was moved or its odometry began anew, map the first "
                "alone and join the second with --session"
            )
    if len(groups) > 1 and not chosen:
        told = "; ".join(f"{_names(group)} of {_time(group[0].start)}" for group in groups)
        raise RecordingError(
            f"{path} holds {len(groups)} drives, more than {LONGEST_PAUSE:g} s apart ({told}): give the files of one, and "
            "join further drives with --session"
        )
    return warnings


def _missing_parts(path: Path, files: Sequence[Path]) -> list[str]:
    """Return a warning about the numbers that are missing among the parts; recorders count them from 0."""
    found = [_PART.fullmatch(_without_packing(file.name)) for file in files]
    numbers = {int(match[2]) for match in found if match is not None}
    stems = {(match[1], match[3]) for match in found if match is not None}
    if None in found or len(stems) != 1 or len(numbers) < len(files) or max(numbers) > _MOST_PARTS:
        return []
    gone = [str(number) for number in range(max(numbers)) if number not in numbers]
    if not gone:
        return []
    text = "the parts of this recording are numbered, and there is no usable part"
    return [f"{path}: {text} {', '.join(gone)}: its topics and transforms are lost with it"]


def _pause(seconds: float, before: _Span, span: _Span) -> str:
    length = f"{seconds:.0f} s" if seconds < 600 else f"{seconds / 60:.0f} minutes"
    return f"nothing was recorded for {length} between {before.file.name} and {span.file.name}: "


def _names(group: Sequence[_Span]) -> str:
    return group[0].file.name if len(group) == 1 else f"{group[0].file.name} to {group[-1].file.name}"


def _time(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S")


def _is_copy(name: str, names: set[str]) -> bool:
    """Return whether a file is the original that rosbag has kept, or the packed form of another file."""
    plain = _without_packing(name)
    if plain != name and plain in names:
        return True
    stem, _, suffix = plain.rpartition(".")
    return stem.endswith(".orig") and f"{stem.removesuffix('.orig')}.{suffix}" in names


def _without_packing(name: str) -> str:
    suffix = Path(name).suffix.lower()
    return name[: -len(suffix)] if suffix in PACKED_ENDINGS else name


def _head(file: Path) -> bytes:
    try:
        with file.open("rb") as opened:
            return opened.read(_HEAD)
    except OSError as error:
        raise RecordingDamaged(f"cannot read {file}: {error.strerror}") from error
