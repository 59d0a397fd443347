"""Opening ROS bags, intact or damaged, and iterating over their topics and messages."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Protocol

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from waychair.errors import RecordingDamaged
from waychair.recordings.bags.bag_parts import BagFiles
from waychair.recordings.bags.rosbag_salvage import SalvagedBag
from waychair.recordings.plausibility.findings import Finding

_LONGEST_REASON = 200  # characters


class BagFile(Protocol):
    """The common interface of an intact and a salvaged bag."""

    is2: bool
    connections: list[Connection]

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]: ...

    def deserialize(self, rawdata: bytes, typ: str) -> Any: ...


@contextmanager
def open_bag(files: BagFiles) -> Iterator[BagFile]:
    """Yield the opened bag, whose messages come from all its files in the order of their logging.

    rosbags goes by a file's suffix, so a file with another suffix is opened through a link with the right one.

    Raises:
        RecordingDamaged: a file of the bag cannot be opened.
    """
    with ExitStack() as stack:
        links: list[Path] = []
        for number, (file, suffix) in enumerate(files.members):
            link = file
            if suffix and file.suffix != suffix:
                link = Path(stack.enter_context(tempfile.TemporaryDirectory())) / f"{number}{suffix}"
                link.symlink_to(file.resolve())
            links.append(link)
        try:
            reader = AnyReader(links, default_typestore=get_typestore(Stores.ROS2_JAZZY))
            stack.enter_context(reader)
        # Damaged bytes raise many kinds of errors in the parser: struct, key, index, decode, sqlite and its own.
        except Exception as error:
            names = {str(link): file.name for link, (file, _) in zip(links, files.members, strict=True)}
            raise damage_error(files.path, error, names) from error
        yield reader


def iterate_messages(
    path: Path, bag: BagFile, connections: Collection[Connection], lost: Counter[str] | None = None
) -> Iterator[tuple[Connection, int, Any]]:
    """Yield connection, time of logging [ns] and message, in bag order.

    If `lost` is given, messages that cannot be decoded are counted there and left out.

    Raises:
        RecordingDamaged: a message cannot be read.
    """
    if not connections:
        return
    raw = bag.messages(connections)
    while True:
        try:
            connection, log_ns, data = next(raw)
        except StopIteration:
            return
        except Exception as error:  # as in `open_bag`
            raise damage_error(path, error) from error
        try:
            message = bag.deserialize(data, connection.msgtype)
        except Exception as error:
            if lost is None:
                reason = " ".join(f"a message on {connection.topic} cannot be decoded: {error}".split())
                raise damage_error(path, reason) from error
            lost["messages"] += 1
            continue
        yield connection, log_ns, message


def counts_by_topic(bag: BagFile, *msgtypes: str) -> dict[str, int]:
    """Return the number of messages of these types by topic."""
    counts: dict[str, int] = {}
    for connection in bag.connections:
        if connection.msgtype in msgtypes:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
    return counts


def missing_messages(path: Path, connections: Collection[Connection], read: Counter[str]) -> list[Finding]:
    """Return a finding for each topic of which a bag holds fewer messages than it tells, as where a file has a hole.

    Raises:
        RecordingDamaged: a topic that it tells is not in its file at all, as where metadata.yaml is that of another bag.
    """
    told: Counter[str] = Counter()
    for connection in connections:
        told[connection.topic] += connection.msgcount
    findings = []
    for topic, count in told.items():
        if count and not read[topic]:
            where = "metadata.yaml" if path.is_dir() else "the index of the file"
            raise damage_error(path, f"{where} tells of {count} messages on {topic}, of which the file holds none")
        if read[topic] < count:
            text = f"{count - read[topic]} of {count} messages are missing from the file, which is damaged"
            findings.append(Finding("missing messages", topic, text, "copy it again from its source"))
    return findings


def topic_list(bag: BagFile) -> str:
    """Return all topics with their types, as text for an error message."""
    topics = sorted({f"{connection.topic} ({connection.msgtype})" for connection in bag.connections})
    return ", ".join(topics) or "no topics at all"


def damage_error(path: Path, error: Exception | str, names: Mapping[str, str] | None = None) -> RecordingDamaged:
    """Return the error for a damaged bag, as one sentence; `names` are the bag's own names of opened files."""
    reason = error if isinstance(error, str) else " ".join(f"{type(error).__name__}: {error}".split())
    for link, name in (names or {}).items():
        reason = reason.replace(link, name)
    reason = reason[:_LONGEST_REASON].rstrip(":. ")
    repair = "repair it (rosbag reindex, ros2 bag reindex, mcap recover) or copy it again from its source"
    return RecordingDamaged(f"{path} is a damaged bag ({reason}); {repair}")


def salvage_bag(files: BagFiles, damage: RecordingDamaged) -> SalvagedBag:
    """Return the readable part of a damaged bag.

    Raises:
        RecordingDamaged: `damage`, because nothing can be read.
    """
    try:
        bag = SalvagedBag(files.members)
    except Exception as error:
        raise damage from error
    if not bag.connections:
        raise damage
    return bag
