"""The aids of a recording are checked before they are believed; what is wrong is corrected or left out, by name."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.geometry import compose, invert, pose_from_array, wrap_angles
from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.upright_scans import upright_scans
from waychair.recordings.recording import Recording
from waychair.recordings.scans import LaserMount, text_from_mount
from waychair.slam.frames.mount_check import MountCheck, check_mount
from waychair.slam.odometry.aid_check import AidCheck, check_aids
from waychair.slam.odometry.aid_findings import (
    AidFinding,
    AidNames,
    AidPart,
    AidState,
    Cause,
    clause,
    finding_from_break,
    name_of,
    remedy,
    sentence,
)
from waychair.slam.odometry.aid_series import ImuSeries, ScanSeries, WheelSeries, from_half_way, half_way
from waychair.slam.odometry.broken_steps import OrderedOdometry, repaired
from waychair.slam.odometry.wild_readings import without_wild_readings
from waychair.slam.scan.scan_motion import ScanMotions, scan_motions
from waychair.types import BoolArray, FloatArray, ImuSample, Json, Odometry, Pose2, SensorFrame, Twist

_LARGEST_YAW, _LARGEST_LEVER = np.radians(8.0), 0.3  # [rad], [m]; a mount that is off by more is not as told
_LEAST_DEVIATIONS = 6.0  # sigma
_MOUNT_SHARE = 0.5  # a better mount leaves at most this share of the disagreement
_STEP, _STEP_TURN = 0.6, 0.3  # [m], [rad]; least motion that tells about a mount
_MANY_SCANS = 1500  # of so many a sample is compared first; all of them only if it shows a fault
_SAMPLE_S, _SAMPLE_EVERY_S = 9.0, 75.0  # long enough for windows that tell about ways
_LEAST_SCANS = 10  # fewer tell nothing about an aid
_REVERSED = "The first beam is the last in time: does the driver give the ranges in reverse order?"
_MOST_SEVERAL = 3  # breaks of one kind that get a sentence each


@dataclass(frozen=True, slots=True)
class CheckedRecording:
    """A recording whose aids can be believed, and the findings that led to it."""

    recording: Recording
    findings: tuple[AidFinding, ...] = ()
    sentences: tuple[str, ...] = ()
    names: AidNames = field(default_factory=AidNames)
    seconds: float = 0.0
    """CPU time of the check."""

    def health(self) -> list[Json]:
        """Return the findings as those about the recording's messages are reported (`plausibility.findings`)."""
        return [
            Finding(
                found.cause.value,
                name_of(found.part, self.names),
                clause(found),
                remedy(found),
                found.count,
                found.since_s,
            ).as_json()
            for found in self.findings
        ]

    def data(self) -> list[Json]:
        """Return the findings for a report."""
        return [finding.data(self.names) for finding in self.findings]


def checked_recording(
    recording: Recording, range_max: float, progress: Callable[[float], None] | None = None
) -> CheckedRecording:
    """Return the recording with aids that agree with its scans, and the findings; a sound one is returned as it is.

    `range_max` [m] is the longest range that is matched.
    """
    started = time.process_time()
    checked = _checked(recording, range_max, progress)
    return replace(checked, seconds=time.process_time() - started)


def _checked(recording: Recording, range_max: float, progress: Callable[[float], None] | None) -> CheckedRecording:
    frames = recording.frames
    scans = sum(frame.scan is not None for frame in frames)
    if scans < _LEAST_SCANS or scans < len(frames) or not any(frame.wheels or frame.imu for frame in frames):
        return CheckedRecording(recording)
    times = _times(frames)
    cleaned, wild = without_wild_readings(frames, times)
    if wild:
        checked = _compared(replace(recording, frames=cleaned), times, range_max, progress)
        return _told(checked.recording, [*wild, *checked.findings])
    return _compared(recording, times, range_max, progress)


def _compared(
    recording: Recording, times: FloatArray, range_max: float, progress: Callable[[float], None] | None
) -> CheckedRecording:
    """Return the recording with aids that agree with its scans: by a sample of a long one, unless it shows a fault."""
    wanted = _looked_at(recording.frames, times)
    if wanted is not None:
        looked = _with_motions(recording, times, range_max, progress, wanted)
        if looked.recording is recording:
            return looked
    return _with_motions(recording, times, range_max, progress, None)


def _looked_at(frames: tuple[SensorFrame, ...], times: FloatArray) -> BoolArray | None:
    """Return which frames (N,) are compared at first, some seconds of every 75; None for all.

    A sound recording is told from a sample. Without wheels, or in gaps of theirs, all scans are needed.
    """
    track = _track(frames, times)
    if (
        len(times) < _MANY_SCANS
        or track is None
        or _wheel_series(track).missing(np.stack([times, times], axis=1)).any()
    ):
        return None
    wanted: BoolArray = times % _SAMPLE_EVERY_S < _SAMPLE_S
    return wanted


def _with_motions(
    recording: Recording,
    times: FloatArray,
    range_max: float,
    progress: Callable[[float], None] | None,
    wanted: BoolArray | None,
) -> CheckedRecording:
    """Return the checked recording by the motions of all scans, or of the wanted ones."""
    frames, mount = recording.frames, recording.base_from_laser
    findings: list[AidFinding] = []
    motions = _scan_motions(frames, mount, range_max, progress, wanted)
    frames, broken = _without_broken_steps(frames, times, motions)
    findings += broken
    check, series = _check(frames, times, motions, wanted)
    if any(found.part is AidPart.LIDAR and found.state is AidState.CORRECTED for found in check.findings):
        frames, swept_back = _upright(frames, mount)
        upright = [found for found in check.findings if found.part is AidPart.LIDAR]
        findings += [
            replace(found, advice=_REVERSED) if swept_back else _advised(found, LaserMount(mount, True))
            for found in upright
        ]
        motions = _scan_motions(frames, mount, range_max, progress, wanted)
        check, series = _check(frames, times, motions, wanted)
    better = _better_mount(frames, motions, mount, check)
    if better is not None:
        told = LaserMount(better.base_from_laser)
        found = AidFinding(
            AidPart.LIDAR, AidState.CORRECTED, Cause.MOUNT, value=better.lever, sigma=float(np.degrees(better.yaw))
        )
        findings.append(_advised(found, told))
        mount = better.base_from_laser
        motions = _scan_motions(frames, mount, range_max, progress, wanted)
        check, series = _check(frames, times, motions, wanted)
    findings += [
        found for found in check.findings if found.part is not AidPart.LIDAR or found.state is AidState.LEFT_OUT
    ]
    unmoved = not any(frame.wheels for frame in frames) and len(motions.before) > 0
    if not unmoved and all(found.state is AidState.NOTED for found in findings):
        return _told(recording, findings)
    frames = _with_gyro(frames, times, check)
    if unmoved:  # an IMU alone tells no way: the scans do
        frames = _with_wheels(frames, times, series.intervals, series.filled())
    elif check.wheels is not None:
        frames = _with_wheels(frames, times, series.intervals, check.wheels)
    elif check.speeds is not None:
        frames = _with_speeds(frames, times, series.intervals, check.speeds)
    return _told(replace(recording, frames=frames, base_from_laser=mount), findings)


def _told(recording: Recording, findings: list[AidFinding]) -> CheckedRecording:
    """Return a recording with the findings about it, by its own topics."""
    names = names_from_source(recording.source)
    return CheckedRecording(recording, tuple(findings), _sentences(findings, names), names)


def names_from_source(source: str) -> AidNames:
    """Return the topics of lidar, wheels and IMU that a recording's source names."""
    told = {kind: rest for kind, _, rest in (part.partition(" ") for part in source.split(", "))}
    usual = AidNames()
    wheels = told.get("odometry", usual.wheels)
    return AidNames(
        told.get("scans", usual.lidar), wheels if "/" in wheels else usual.wheels, told.get("IMU", usual.imu)
    )


def _upright(frames: tuple[SensorFrame, ...], mount: Pose2) -> tuple[tuple[SensorFrame, ...], bool]:
    """Return the frames with mirrored scans, and whether a driver reversed their ranges."""
    odometry = [reading for frame in frames for reading in frame.wheels if isinstance(reading, Odometry)]
    found, swept_back = upright_scans([frame.scan for frame in frames if frame.scan is not None], odometry, mount)
    scans = iter(found)
    return tuple(frame if frame.scan is None else replace(frame, scan=next(scans)) for frame in frames), swept_back


def _advised(found: AidFinding, mount: LaserMount) -> AidFinding:
    advice = f"They agree best with --base-from-laser {text_from_mount(mount)}"
    if found.cause is Cause.MIRRORED_OR_WHEELS:
        advice += "; if it hangs upright, --odom none makes a map that is not mirrored"
    return replace(found, advice=advice)


def _sentences(findings: list[AidFinding], names: AidNames) -> tuple[str, ...]:
    """Return the sentences; of many breaks of one kind the first ones, and the number of the others."""
    kept: list[AidFinding] = []
    more = 0
    steps = (Cause.WILD, Cause.RESTART, Cause.JUMP)
    for cause in steps:
        same = [found for found in findings if found.cause is cause and found.part is AidPart.WHEELS]
        kept += same[:_MOST_SEVERAL]
        more += len(same[_MOST_SEVERAL:])
    rest = [found for found in findings if found.cause not in steps or found.part is not AidPart.WHEELS]
    told = [sentence(found, names) for found in (*kept, *rest)]
    if more:
        told.insert(len(kept), f"{names.wheels}: {more} more steps that no chair drives were bridged")
    return tuple(told)


def _times(frames: tuple[SensorFrame, ...]) -> FloatArray:
    """Return times (N,) [s] of the frames from the first on that ascend, also where the recording's clock was set back."""
    stamps = np.array([frame.stamp_ns for frame in frames], np.int64)
    steps = np.diff(stamps) * 1e-9
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.1
    steps = np.where((steps > 0.0) & (steps < 600.0), steps, usual)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _scan_motions(
    frames: tuple[SensorFrame, ...],
    mount: Pose2,
    range_max: float,
    progress: Callable[[float], None] | None,
    wanted: BoolArray | None,
) -> ScanMotions:
    """Return the motions between the scans, with `before` and `after` as indices of the frames."""
    indices = np.array([k for k, frame in enumerate(frames) if frame.scan is not None], np.int64)
    scans = [frame.scan for frame in frames if frame.scan is not None]
    found = scan_motions(scans, mount, range_max, progress, None if wanted is None else wanted[indices])
    return replace(found, before=indices[found.before], after=indices[found.after])


def _without_broken_steps(
    frames: tuple[SensorFrame, ...], times: FloatArray, motions: ScanMotions
) -> tuple[tuple[SensorFrame, ...], list[AidFinding]]:
    track = _track(frames, times)
    if track is None:
        return frames, []
    chain = _ScanChain(motions, times)
    mended, breaks = repaired(track, chain.between)
    if not breaks:
        return frames, []
    poses = iter(mended.poses)
    changed = []
    for frame in frames:
        wheels = tuple(
            replace(reading, odom_from_base=pose_from_array(next(poses))) if isinstance(reading, Odometry) else reading
            for reading in frame.wheels
        )
        changed.append(replace(frame, wheels=wheels))
    return tuple(changed), [finding_from_break(found) for found in breaks]


def _track(frames: tuple[SensorFrame, ...], times: FloatArray) -> OrderedOdometry | None:
    rows = [
        (
            time + (reading.stamp_ns - frame.stamp_ns) * 1e-9,
            reading,
            k == len(frame.wheels) - 1 and reading.stamp_ns == frame.stamp_ns,
        )
        for time, frame in zip(times.tolist(), frames, strict=True)
        for k, reading in enumerate(frame.wheels)
        if isinstance(reading, Odometry)
    ]
    if len(rows) < 10:
        return None
    return OrderedOdometry(
        times=np.maximum.accumulate(np.array([row[0] for row in rows])),
        poses=np.array([row[1].odom_from_base.array() for row in rows]),
        speeds=np.array([(row[1].twist.v, row[1].twist.omega) for row in rows]),
        between=np.array([row[2] for row in rows]),
    )


def _wheel_series(track: OrderedOdometry) -> WheelSeries:
    return WheelSeries(track.times, track.poses, track.speeds, track.times[~track.between])


class _ScanChain:
    """The motions by scans, chained: gives the motion between any two times within measured intervals."""

    def __init__(self, motions: ScanMotions, times: FloatArray) -> None:
        self._begin, self._end = times[motions.before], times[motions.after]
        self._motions = half_way(motions.motions)
        self._known = motions.turn_known & motions.way_known

    def between(self, begin_s: float, end_s: float) -> FloatArray | None:
        """Return the motion (3,) between two times, None where a scan on the way was not measured."""
        first, last = np.searchsorted(self._end, begin_s, "right"), np.searchsorted(self._begin, end_s, "left")
        inside = np.arange(first, last)
        if not len(inside) or not self._known[inside].all():
            return None
        length = np.maximum(self._end[inside] - self._begin[inside], 1e-6)
        part = (np.minimum(self._end[inside], end_s) - np.maximum(self._begin[inside], begin_s)) / length
        if float((part * length).sum()) < 0.9 * (end_s - begin_s):
            return None
        total = np.zeros(3)
        for step in from_half_way(part[:, None] * self._motions[inside]):
            total = compose(total, step)
        return total


def _check(
    frames: tuple[SensorFrame, ...], times: FloatArray, motions: ScanMotions, wanted: BoolArray | None
) -> tuple[AidCheck, ScanSeries]:
    """Return the check of the aids by the motions of scans, and the intervals to which it refers: of a sample (`wanted`)
    those that were compared, else the whole recording's."""
    series = ScanSeries(
        np.stack([times[motions.before], times[motions.after]], axis=1), half_way(motions.motions), motions.turn_known,
        motions.way_known, np.ones(len(motions.before), np.bool_), _sweep_s(frames),
    )  # fmt: skip
    if wanted is None:
        series = series.with_all(times)
    track = _track(frames, times)
    wheels = None if track is None else _wheel_series(track)
    return check_aids(series, wheels, _imu_series(frames, times)), series


def _sweep_s(frames: tuple[SensorFrame, ...]) -> float:
    """Return the median time [s] of a sweep."""
    scans = [frame.scan for frame in frames if frame.scan is not None]
    return float(np.median([scan.time_step * (len(scan.ranges) - 1) for scan in scans]))


def _imu_series(frames: tuple[SensorFrame, ...], times: FloatArray) -> ImuSeries | None:
    rows = [
        (time + (sample.stamp_ns - frame.stamp_ns) * 1e-9, sample)
        for time, frame in zip(times.tolist(), frames, strict=True)
        for sample in frame.imu
    ]
    if len(rows) < 10:
        return None
    return ImuSeries(
        np.maximum.accumulate(np.array([row[0] for row in rows])),
        np.array([row[1].gyro for row in rows]),
        np.array([row[1].accel for row in rows]),
    )


def _better_mount(
    frames: tuple[SensorFrame, ...], motions: ScanMotions, mount: Pose2, check: AidCheck
) -> MountCheck | None:
    """Return the mount by which wheels and scans agree, if the told one is certainly wrong and the wheels are sound."""
    turns_wrong = any(found.part in (AidPart.WHEEL_TURN, AidPart.LIDAR, AidPart.WHEELS) for found in check.findings)
    poses = _poses(frames)
    if turns_wrong or poses is None or len(motions.before) < 20:
        return None
    wheels, scans = [], []
    start = 0
    chained, whole = np.zeros(3), True
    for k in range(len(motions.before)):
        if k > 0 and motions.before[k] != motions.after[k - 1]:
            start, chained, whole = k, np.zeros(3), True
        chained = compose(chained, motions.motions[k])
        whole = whole and bool(motions.turn_known[k] and motions.way_known[k])
        step = compose(invert(poses[motions.before[start]]), poses[motions.after[k]])
        if np.hypot(*step[:2]) >= _STEP or abs(step[2]) >= _STEP_TURN:
            if whole:
                wheels.append(step)
                scans.append(chained)
            start, chained, whole = k + 1, np.zeros(3), True
    if len(wheels) < 20:
        return None
    steps = np.array(wheels)
    along, across = np.abs(half_way(steps)[:, :2]).sum(axis=0)
    found = check_mount(steps, np.array(scans), mount)
    backward = float(steps[:, 0].sum()) < 0.0  # a chair drives forward most of the time
    if found is None or backward or across > 0.2 * along or not 0.5 < found.scale < 2.0:
        return None
    if found.deviations < _LEAST_DEVIATIONS:
        return None
    yawed = abs(found.yaw) > _LARGEST_YAW and found.residual_after < _MOUNT_SHARE * found.residual_before
    moved = found.lever > _LARGEST_LEVER and found.lever_is_clear()
    return found if yawed or moved else None


def _poses(frames: tuple[SensorFrame, ...]) -> FloatArray | None:
    """Return the odometry (N, 3) at each frame; None where a frame has none."""
    rows = []
    for frame in frames:
        own = [reading for reading in frame.wheels if isinstance(reading, Odometry)]
        if not own:
            return None
        rows.append(own[-1].odom_from_base.array())
    return np.array(rows)


def _with_gyro(frames: tuple[SensorFrame, ...], times: FloatArray, check: AidCheck) -> tuple[SensorFrame, ...]:
    """Return the frames with the IMU's samples as the check says."""
    if not check.gyro and check.force.scale == 1.0 and check.force.level is None:
        return frames
    used = [
        tuple(
            changed
            for sample in frame.imu
            if (changed := _sample(sample, time_s + (sample.stamp_ns - frame.stamp_ns) * 1e-9, check)) is not None
        )
        for time_s, frame in zip(times.tolist(), frames, strict=True)
    ]
    if not any(use.delay_s for use in check.gyro):
        return tuple(replace(frame, imu=own) for frame, own in zip(frames, used, strict=True))
    ordered = sorted((sample for own in used for sample in own), key=lambda sample: sample.stamp_ns)
    done, moved = 0, []
    for frame in frames:
        until = done
        while until < len(ordered) and ordered[until].stamp_ns <= frame.stamp_ns:
            until += 1
        moved.append(replace(frame, imu=tuple(ordered[done:until])))
        done = until
    return tuple(moved)


def _sample(sample: ImuSample, time_s: float, check: AidCheck) -> ImuSample | None:
    use = next((use for use in check.gyro if use.begin_s < time_s <= use.end_s), None)
    level = check.force.level
    if level is not None:
        sample = replace(sample, accel=level @ sample.accel, gyro=level @ sample.gyro)
    accel = sample.accel * check.force.scale if check.force.scale else np.full(3, np.nan)
    if use is None:
        return replace(sample, accel=accel)
    if use.axis is None:
        return None
    rate = float(sample.gyro @ use.axis) / use.scale - use.bias
    upright = use.axis[2] == 1.0 and use.scale > 0.0
    sideways = sample.gyro[:2] / use.scale - use.sideways if upright else np.zeros(2)
    stamp_ns = sample.stamp_ns - round(use.delay_s * 1e9)
    return ImuSample(stamp_ns, accel if upright else np.full(3, np.nan), np.array([*sideways, rate]))


def _with_speeds(
    frames: tuple[SensorFrame, ...], times: FloatArray, intervals: FloatArray, moved: FloatArray
) -> tuple[SensorFrame, ...]:
    """Return the frames with the twists of their odometry from its own motions (N, 3) over intervals (N, 2) [s]."""
    middle, rates = _rates(intervals, moved)
    changed = []
    for begin_s, frame in zip(times.tolist(), frames, strict=True):
        wheels = []
        for reading in frame.wheels:
            if isinstance(reading, Odometry):
                at = begin_s + (reading.stamp_ns - frame.stamp_ns) * 1e-9
                v, omega = (float(np.interp(at, middle, rates[:, column])) for column in (0, 2))
                reading = replace(reading, twist=Twist(v, omega))
            wheels.append(reading)
        changed.append(replace(frame, wheels=tuple(wheels)))
    return tuple(changed)


def _rates(intervals: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles (N,) [s] of the intervals, and the rates (N, 3) of their motions."""
    seconds = np.maximum(intervals[:, 1] - intervals[:, 0], 1e-6)
    return intervals.mean(axis=1), np.nan_to_num(moved) / seconds[:, None]


def _with_wheels(
    frames: tuple[SensorFrame, ...], times: FloatArray, intervals: FloatArray, used: FloatArray
) -> tuple[SensorFrame, ...]:
    """Return the frames with one odometry reading each, at its stamp, from motions (N, 3) half way through the turn, over
    intervals (N, 2) [s] that follow each other."""
    used = np.nan_to_num(used)
    poses = [np.zeros(3)]
    for step in from_half_way(used):
        poses.append(compose(poses[-1], step))
    knots, corners = np.append(intervals[0, 0], intervals[:, 1]), np.array(poses)
    corners[:, 2] = np.unwrap(corners[:, 2])
    at = np.stack([np.interp(times, knots, column) for column in corners.T], axis=1)
    middle, rates = _rates(intervals, used)
    v, omega = (np.interp(times, middle, rates[:, column]) for column in (0, 2))
    changed = []
    for k, frame in enumerate(frames):
        pose = pose_from_array(np.array([at[k, 0], at[k, 1], float(wrap_angles(at[k, 2:3])[0])]))
        changed.append(replace(frame, wheels=(Odometry(frame.stamp_ns, pose, Twist(float(v[k]), float(omega[k]))),)))
    return tuple(changed)
