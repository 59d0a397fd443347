"""Synchronisation of sensor messages: groups them into frames, each with all wheel and IMU readings since the last.

No clock is read: time passes with the stamps. `message_sets` groups scans and pictures. A frame is returned once wheels
and IMU have reached its stamp, or are late.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from waychair.calibration.fits.time_offset import SensorDelays, without_delay
from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import interpolate
from waychair.slam.frames.message_sets import ApproximateSets, ExactSets, MessageCounts, MessageQueue, MessageSets
from waychair.topics import Topic
from waychair.types import ImuSample, Odometry, RgbdFrame, Scan, SensorFrame, SonarReadings, Twist, WheelTicks

Snapshot: TypeAlias = Scan | RgbdFrame | SonarReadings
Reading: TypeAlias = WheelTicks | Odometry | ImuSample

_SNAPSHOTS: dict[type, str] = {Scan: "scan", RgbdFrame: "rgbd", SonarReadings: "sonar"}
_STREAMS: dict[type, str] = {WheelTicks: "wheels", Odometry: "wheels", ImuSample: "imu"}
"""Fields of a frame by topic type: one message per frame of a snapshot, all readings of a stream."""

_RATE_MESSAGES = 21
"""Number of messages from which a rate is computed."""

_COUNTS = 2**32  # encoder counters wrap at this count
QUEUE = 10  # scans or pictures that wait for partners
STREAM_QUEUE = 2000  # wheel or IMU readings that wait for a frame
_AGE_PENALTY = 0.1  # by which a later set must be better, see `ApproximateSets`
_LEAST_GAP = 0.5  # share of its period by which two messages of a topic are apart at least
_RESET_S = 2.0  # a stamp further back means that the clock was set back

_SLOW = 0.7
"""A topic whose rate is below this share of the nominal rate gets a complaint."""


@dataclass(frozen=True, slots=True)
class SynchroniserSettings(Settings):
    """How far apart the messages of a frame may be, and how long a frame waits for them."""

    exact: bool = setting(False, "", "true: a frame's scan and pictures must have the same stamp")
    max_spread_s: float = setting(
        0.05, "s", "largest time between a frame's scan and pictures; larger: fewer frames are lost, motion is blurred",
        low=0.0, high=10.0,
    )  # fmt: skip
    wait_s: float = setting(
        0.1, "s", "longest wait of a frame for wheel and IMU readings; larger: late readings delay frames more",
        low=0.0, high=10.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class TopicStatus:
    """Health of a topic: rate [Hz] by its last stamps, age [s] of the last one (None: no message), delay [s] behind the
    newest topic, message counts, and a complaint as a sentence, or ''."""

    name: str
    rate_hz: float
    age_s: float | None
    behind_s: float
    counts: MessageCounts
    complaint: str


class Synchroniser:
    """Collects messages until they form a frame.

    The first topic of scans, pictures or sonars sets a frame's stamp; stamps of frames ascend. `wheels` and `imu` of a
    frame are the readings after the stamp of the frame before, up to its own. If no wheel reading has the frame's stamp,
    one is interpolated between its neighbours.
    """

    def __init__(self, topics: Sequence[Topic], settings: SynchroniserSettings | None = None) -> None:
        """
        Raises:
            ConfigError: no topic is a snapshot, a topic has a type without a frame field, or two have the same field.
        """
        self.settings = settings or SynchroniserSettings()
        self.resets = 0
        self.incomplete = 0
        _check_topics(topics)
        self._topics = {topic.name: topic for topic in topics}
        self._fields = {topic.name: (_SNAPSHOTS | _STREAMS)[topic.type] for topic in topics}
        self._sets = _sets_for([topic for topic in topics if topic.type in _SNAPSHOTS], self.settings)
        self._streams: dict[str, MessageQueue[Reading]] = {
            topic.name: MessageQueue(STREAM_QUEUE) for topic in topics if topic.type in _STREAMS
        }
        self._queues: dict[str, MessageQueue[Any]] = {**self._sets.queues, **self._streams}
        self._stamps: dict[str, deque[int]] = {topic.name: deque(maxlen=_RATE_MESSAGES) for topic in topics}
        self._pending: deque[tuple[Snapshot, ...]] = deque()
        self._before: dict[str, Reading] = {}  # the last reading of each stream in a frame

    def add(self, topic: Topic | str, message: Snapshot | Reading) -> tuple[SensorFrame, ...]:
        """Add a message, and return the frames that it completes, in order of time.

        Raises:
            ConfigError: the topic was not announced.
        """
        name = topic.name if isinstance(topic, Topic) else topic
        if name not in self._topics:
            raise ConfigError(f"unknown topic '{name}'; the synchroniser was made for {', '.join(self._topics)}")
        newest = self._queues[name].newest_ns
        before: tuple[SensorFrame, ...] = ()
        if newest is not None and message.stamp_ns < newest - round(_RESET_S * 1e9):
            before = self.flush()
            self._restart()
        self._stamps[name].append(message.stamp_ns)
        if name in self._streams:
            self._streams[name].put(cast(Reading, message))
        else:
            self._pending.extend(self._sets.add(name, cast(Snapshot, message)))
        return before + self._ready(wait=True)

    def flush(self) -> tuple[SensorFrame, ...]:
        """Return the frames that still wait for wheels or IMU, without these; for the end of a recording."""
        return self._ready(wait=False)

    def diagnostics(self, now_ns: int) -> tuple[TopicStatus, ...]:
        """Return the health of each topic at a time of the stamps' clock."""
        newest = {name: queue.newest_ns for name, queue in self._queues.items() if queue.newest_ns is not None}
        ahead = max(newest, key=lambda name: newest[name], default="")
        return tuple(self._status(topic, newest, ahead, now_ns) for topic in self._topics.values())

    def _ready(self, *, wait: bool) -> tuple[SensorFrame, ...]:
        frames = []
        while self._pending and not (wait and self._must_wait(self._pending[0][0].stamp_ns)):
            frames.append(self._frame(self._pending.popleft()))
        return tuple(frames)

    def _must_wait(self, stamp_ns: int) -> bool:
        """Return whether wheel or IMU readings of a frame may still arrive."""
        newest = [queue.newest_ns for queue in self._queues.values() if queue.newest_ns is not None]
        if max(newest) - stamp_ns > round(self.settings.wait_s * 1e9):
            return False
        return any(queue.newest_ns is None or queue.newest_ns < stamp_ns for queue in self._streams.values())

    def _frame(self, snapshots: tuple[Snapshot, ...]) -> SensorFrame:
        stamp = snapshots[0].stamp_ns
        parts: dict[str, object] = {
            self._fields[name]: message for name, message in zip(self._sets.queues, snapshots, strict=True)
        }
        complete = True
        for name, queue in self._streams.items():
            readings = queue.take_until(stamp)
            before = readings[-1] if readings else self._before.get(name)
            complete = complete and queue.newest_ns is not None and queue.newest_ns >= stamp
            if before is not None:
                self._before[name] = before
                if queue.waiting and before.stamp_ns < stamp:
                    readings += _interpolated(before, queue.waiting[0], stamp)
            parts[self._fields[name]] = tuple(readings)
        self.incomplete += not complete
        return SensorFrame(stamp, **parts)  # type: ignore[arg-type]

    def _restart(self) -> None:
        self.resets += 1
        self._before.clear()
        for name, queue in self._queues.items():
            queue.clear()
            self._stamps[name].clear()

    def _status(self, topic: Topic, newest: dict[str, int], ahead: str, now_ns: int) -> TopicStatus:
        stamps, last = self._stamps[topic.name], newest.get(topic.name)
        span = max(stamps) - min(stamps) if len(stamps) > 1 else 0
        rate = (len(stamps) - 1) * 1e9 / span if span else 0.0
        age = None if last is None else (now_ns - last) * 1e-9
        behind = 0.0 if last is None else (newest[ahead] - last) * 1e-9
        complaint = _complaint(topic, rate, age, behind, ahead)
        counts = dataclasses.replace(self._queues[topic.name].counts)
        return TopicStatus(
            name=topic.name, rate_hz=rate, age_s=age, behind_s=behind, counts=counts, complaint=complaint
        )


def frames_with_delays(frames: Sequence[SensorFrame], delays: SensorDelays) -> tuple[SensorFrame, ...]:
    """Return a recording's frames with all stamps corrected for the sensors' delays.

    The frames keep their order. Each gets the wheel and IMU readings since the frame before by the corrected stamps, and
    an interpolated wheel reading at its own stamp.
    """
    if delays == SensorDelays():
        return tuple(frames)
    wheels, imu = MessageQueue[Reading](sys.maxsize), MessageQueue[Reading](sys.maxsize)
    for frame in frames:
        for queue, readings in ((wheels, frame.wheels), (imu, frame.imu)):
            for reading in readings:
                queue.put(without_delay(reading, delays))
    corrected: list[SensorFrame] = []
    last: Reading | None = None
    for frame in frames:
        scan, rgbd, sonar = (without_delay(part, delays) for part in (frame.scan, frame.rgbd, frame.sonar))
        stamp = next((part.stamp_ns for part in (scan, rgbd, sonar) if part is not None), frame.stamp_ns)
        own = wheels.take_until(stamp)
        last = own[-1] if own else last
        if last is not None and last.stamp_ns < stamp and wheels.waiting:
            own += _interpolated(last, wheels.waiting[0], stamp)
        corrected.append(
            SensorFrame(
                stamp_ns=stamp, scan=scan, rgbd=rgbd, sonar=sonar,  # type: ignore[arg-type]
                wheels=tuple(own), imu=tuple(imu.take_until(stamp)),  # type: ignore[arg-type]
            )
        )  # fmt: skip
    return tuple(corrected)


def _interpolated(before: Reading, after: Reading, stamp_ns: int) -> list[Reading]:
    """Return a wheel reading interpolated linearly at a stamp between two others; nothing for an IMU."""
    part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    if isinstance(before, WheelTicks) and isinstance(after, WheelTicks):
        left, right = (
            begin + round(part * ((end - begin + _COUNTS // 2) % _COUNTS - _COUNTS // 2))
            for begin, end in ((before.left, after.left), (before.right, after.right))
        )
        return [WheelTicks(stamp_ns, _wrapped(left), _wrapped(right))]
    if isinstance(before, Odometry) and isinstance(after, Odometry):
        v = before.twist.v + part * (after.twist.v - before.twist.v)
        omega = before.twist.omega + part * (after.twist.omega - before.twist.omega)
        pose = interpolate(before.odom_from_base, after.odom_from_base, part)
        return [Odometry(stamp_ns, pose, Twist(v, omega), after.covariance)]
    return []


def _wrapped(count: int) -> int:
    """Return a count as a signed 32-bit number."""
    return (count + _COUNTS // 2) % _COUNTS - _COUNTS // 2


def _check_topics(topics: Sequence[Topic]) -> None:
    taken: dict[str, str] = {}
    for topic in topics:
        field = (_SNAPSHOTS | _STREAMS).get(topic.type)
        if field is None:
            raise ConfigError(
                f"{topic.name} has type {topic.type.__name__}, which frames do not hold: remove this topic"
            )
        if field in taken:
            raise ConfigError(f"{taken[field]} and {topic.name} both give a frame's {field}: remove one of them")
        taken[field] = topic.name
    if not any(topic.type in _SNAPSHOTS for topic in topics):
        raise ConfigError("no topic has scans, pictures or sonar readings: add one of these")


def _sets_for(topics: Sequence[Topic], settings: SynchroniserSettings) -> MessageSets[Snapshot]:
    names = [topic.name for topic in topics]
    if settings.exact:
        return ExactSets(names, QUEUE)
    gaps = [round(_LEAST_GAP * 1e9 / topic.rate_hz) if topic.rate_hz else 0 for topic in topics]
    return ApproximateSets(
        names,
        QUEUE,
        max_spread_ns=round(settings.max_spread_s * 1e9),
        age_penalty=_AGE_PENALTY,
        least_gaps_ns=gaps,
    )


def _complaint(topic: Topic, rate_hz: float, age_s: float | None, behind_s: float, ahead: str) -> str:
    """Return the fault of a topic and its remedy as a sentence; '' for none."""
    name = f"/{topic.name}"
    if age_s is None:
        return f"no message on {name}: start its node or check the topic's name"
    limit_ns = topic.max_age_ns()
    if limit_ns is None:
        return ""
    limit_s = limit_ns * 1e-9
    if age_s < -limit_s:
        return f"{name} is {-age_s:.1f} s ahead of this computer: set both clocks by one time server"
    if behind_s > limit_s:
        return f"{name} is {behind_s:.1f} s behind /{ahead}: check its clock or its node"
    if age_s > limit_s:
        return f"{name} has been silent for {age_s:.1f} s: check its cable and its node"
    if 0.0 < rate_hz < _SLOW * topic.rate_hz:
        return f"{name} has {rate_hz:.1f} Hz instead of {topic.rate_hz:g} Hz: check the load and the link"
    return ""
