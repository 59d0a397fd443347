"""Kind 2: lidar messages with codes, units, limits, times and sizes that cannot be; scans that are missing or repeated."""

from __future__ import annotations

import math

import numpy as np

from evaluation.corruptions.fault import faults_of, messages_fault
from evaluation.corruptions.messages import SCAN, BagMessage, Messages, change, set_stamp, stamp_of
from evaluation.corruptions.sound_drive import PERIOD_S, REACH_M, SECOND

Rng = np.random.Generator
_CODE = "code|nothing|share|same value|range_max"
_UNIT = "units?|millimet|mm|cm|centimet|scale|the ranges are|the median range"
_ANGLE = "angle|degrees|increment|beams"
_LIMIT = "range_min|range_max|limit|exchanged|contradict"
_SWEEP = "time_increment|sweep|scan_time|point"
_STAMP = "stamp|clock|order|set back"
_SIZE = "sizes?|beams|count|length|empty|no distance"


def _scans(messages: Messages) -> list[BagMessage]:
    return messages.of(SCAN)


def _some(events: list[BagMessage], rng: Rng, share: float | None = None) -> list[BagMessage]:
    """Return all messages, a share of them, or one, drawn where no share is given."""
    share = float(rng.choice([0.0, 0.3, 1.0])) if share is None else share
    chosen = [event for event in events if rng.random() < share]
    return chosen or [events[int(rng.integers(len(events)))]]


def _ranges_by(events: list[BagMessage], by: float) -> None:
    for event in events:
        event.body.ranges = (event.body.ranges * np.float32(by)).astype(np.float32)


@messages_fault(2, "lidar", _CODE)
def nothing_is_a_code(messages: Messages, rng: Rng) -> None:
    reach = float(rng.choice([2.5, 4.0]))
    code = float(rng.choice([reach, reach - 0.01, 8.01, REACH_M, 65.533, 0.0, -1.0, reach + 1.0]))
    for event in _scans(messages):
        body = event.body
        body.range_max = max(reach, code) + float(rng.choice([0.0, 0.0, 10.0]))
        body.ranges = np.where(body.ranges > reach, np.float32(code), body.ranges).astype(np.float32)


@messages_fault(2, "lidar", _CODE + "|near|chair|mask|self|often|moves|footrest")
def many_beams_see_the_chair(messages: Messages, rng: Rng) -> None:
    width, far = int(rng.integers(10, 60)), float(rng.uniform(0.12, 0.4))
    noise = float(rng.choice([0.0, 0.005]))
    first = int(rng.integers(180))
    where = (first + np.arange(width)) % 180
    for event in _scans(messages):
        event.body.ranges[where] = far + noise * rng.standard_normal(width)


@messages_fault(2, "lidar", _UNIT)
def ranges_are_in_other_units(messages: Messages, rng: Rng) -> None:
    unit, scans = float(rng.choice([1000.0, 100.0, 39.37, 0.001])), _scans(messages)
    _ranges_by(scans, unit)
    if rng.random() < 0.5:
        for event in scans:
            event.body.range_min, event.body.range_max = unit * event.body.range_min, unit * event.body.range_max


@messages_fault(2, "lidar", _UNIT + "|wild")
def some_scans_are_in_other_units(messages: Messages, rng: Rng) -> None:
    _ranges_by(_some(_scans(messages), rng, float(rng.choice([0.0, 0.1, 0.4]))), 1000.0)


@messages_fault(2, "lidar", "scale")
def ranges_are_some_per_cent_off(messages: Messages, rng: Rng) -> None:
    _ranges_by(_scans(messages), float(rng.choice([0.9, 0.98, 1.02, 1.1])))


@messages_fault(2, "lidar", _ANGLE)
def angles_are_in_degrees(messages: Messages, rng: Rng) -> None:
    fields = ["angle_min", "angle_max", "angle_increment"]
    chosen = fields if rng.random() < 0.5 else [str(rng.choice(fields))]
    for event in _some(_scans(messages), rng):
        for name in chosen:
            change(event.body, name, lambda value: value * 180 / math.pi)


@messages_fault(2, "lidar", _ANGLE + "|exchanged|contradict|other way|mirror|upside")
def angles_contradict_each_other(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(6))
    for event in _some(_scans(messages), rng):
        body = event.body
        if which == 0:
            body.angle_min, body.angle_max = body.angle_max, body.angle_min
        elif which == 1:
            body.angle_increment = -body.angle_increment
        elif which == 2:
            body.angle_increment = 0.0
        elif which == 3:
            body.angle_increment = math.nan
        elif which == 4:
            body.angle_increment *= 0.5
        else:
            body.angle_min += 2.0


@messages_fault(2, "lidar", _ANGLE + "|mirror|upside|other way|exchanged")
def beams_are_in_reverse_order(messages: Messages, rng: Rng) -> None:
    for event in _scans(messages):
        event.body.ranges = event.body.ranges[::-1].copy()


@messages_fault(2, "lidar", _LIMIT)
def limits_are_wrong(messages: Messages, rng: Rng) -> None:
    least, most = [
        (REACH_M, 0.1), (0.0, 0.0), (math.nan, math.nan), (0.1, math.inf), (0.1, -1.0), (5.0, 5.0), (0.1, 1e9),
        (0.1, 2.0)][int(rng.integers(8))]  # fmt: skip
    for event in _some(_scans(messages), rng):
        event.body.range_min, event.body.range_max = least, most


@messages_fault(2, "lidar", _SWEEP)
def time_increment_is_wrong(messages: Messages, rng: Rng) -> None:
    beam_s = PERIOD_S / 180
    told = float(
        rng.choice([beam_s * 1e9, beam_s * 1e6, beam_s * 1e3, PERIOD_S, -beam_s, math.nan, math.inf, 0.0, 20 * beam_s])
    )
    for event in _some(_scans(messages), rng):
        event.body.time_increment = told


@messages_fault(2, "lidar", _SWEEP)
def scan_time_is_wrong(messages: Messages, rng: Rng) -> None:
    told = float(rng.choice([0.0, 1e8, -1.0, math.nan, 0.01]))
    for event in _scans(messages):
        event.body.scan_time = told
        if rng.random() < 0.5:
            event.body.time_increment = 0.0


@messages_fault(2, "lidar", _SIZE)
def scans_are_empty(messages: Messages, rng: Rng) -> None:
    for event in _some(_scans(messages), rng, float(rng.choice([0.0, 0.1, 0.5, 1.0]))):
        event.body.ranges = np.zeros(0, np.float32)


@messages_fault(2, "lidar", _SIZE + "|" + _ANGLE)
def scans_have_other_sizes(messages: Messages, rng: Rng) -> None:
    size = int(rng.choice([1, 90, 179, 181, 360, 1_000_000]))
    for event in _some(_scans(messages), rng, 0.0 if size > 360 else None):
        event.body.ranges = np.resize(event.body.ranges, size).astype(np.float32)


@messages_fault(2, "lidar", "finite|nan|distance|zero|empty")
def scans_hold_no_distance(messages: Messages, rng: Rng) -> None:
    value = float(rng.choice([math.nan, math.inf, 0.0, -math.inf]))
    for event in _some(_scans(messages), rng, float(rng.choice([0.0, 0.2, 1.0]))):
        event.body.ranges = np.full_like(event.body.ranges, value)


@messages_fault(2, "lidar", "nan|far|large|beyond|wild|cells|finite")
def some_ranges_are_wild(messages: Messages, rng: Rng) -> None:
    value, lifted = float(rng.choice([1e6, 1e30, math.nan, -5.0])), rng.random() < 0.5
    for event in _some(_scans(messages), rng):
        event.body.ranges[rng.integers(0, 180, int(rng.choice([1, 20])))] = value
        if lifted:
            event.body.range_max = 1e31


@messages_fault(2, "lidar", "noise|spread|worse|agree|scatter")
def ranges_are_noisy(messages: Messages, rng: Rng) -> None:
    sigma = float(rng.choice([0.03, 0.1]))
    for event in _scans(messages):
        event.body.ranges = (event.body.ranges + sigma * rng.standard_normal(180)).astype(np.float32)


@messages_fault(2, ("lidar", "clock"), _STAMP)
def scans_have_no_stamps(messages: Messages, rng: Rng) -> None:
    for event in _some(_scans(messages), rng):
        set_stamp(event.body, 0)


@messages_fault(2, ("lidar", "clock", "odometry"), _STAMP + "|late|delay|before|after")
def scans_have_another_clock(messages: Messages, rng: Rng) -> None:
    by = float(rng.choice([-1.7e9, 3600.0, -7200.0, 0.5, -0.5, 1.5]))
    for event in _scans(messages):
        set_stamp(event.body, max(1, stamp_of(event.body) + int(by * SECOND)))


@messages_fault(2, ("lidar", "clock"), _STAMP + "|gap|apart|jump")
def one_scan_has_a_wild_stamp(messages: Messages, rng: Rng) -> None:
    for event in _some(_scans(messages), rng, float(rng.choice([0.0, 0.05]))):
        by = float(rng.choice([-86400.0, 86400.0, 3.0e8, -1.0, 2.0]))
        set_stamp(event.body, max(1, stamp_of(event.body) + int(by * SECOND)))


@messages_fault(2, ("lidar", "clock"), _STAMP + "|twice|repeat|duplicate")
def stamps_repeat(messages: Messages, rng: Rng) -> None:
    scans, every = _scans(messages), int(rng.choice([2, 5, 1000]))
    for k, event in enumerate(scans):
        set_stamp(event.body, stamp_of(scans[k - k % every].body))


@messages_fault(2, ("lidar", "clock"), _STAMP + "|second|coarse|jitter|odometry")
def stamps_are_coarse(messages: Messages, rng: Rng) -> None:
    step = int(float(rng.choice([0.1, 1.0])) * SECOND)
    for event in _scans(messages):
        set_stamp(event.body, stamp_of(event.body) // step * step)


@messages_fault(2, ("clock", "lidar", "odometry"), _STAMP + "|continued|jump")
def the_clock_is_set(messages: Messages, rng: Rng) -> None:
    by = int(float(rng.choice([-3600.0, 3600.0, -20.0, 5.0, -1.715e9])) * SECOND)
    at = messages.events[int(rng.uniform(0.3, 0.7) * len(messages.events))].log_ns
    logged_too = rng.random() < 0.5 and by > 0
    for event in messages.events:
        if event.log_ns >= at and hasattr(event.body, "header"):
            set_stamp(event.body, stamp_of(event.body) + by)
            event.log_ns += by if logged_too else 0


@messages_fault(2, "lidar", "gap|missing|silen|apart|no scan")
def scans_are_missing(messages: Messages, rng: Rng) -> None:
    scans = _scans(messages)
    first = int(rng.integers(20, 120))
    gone = scans[first : first + int(rng.integers(4, 30))] if rng.random() < 0.5 else _some(scans, rng, 0.5)
    messages.remove(gone)


@messages_fault(2, "lidar", "twice|repeat|duplicate|same|stick|stuck|frozen")
def scans_come_twice(messages: Messages, rng: Rng) -> None:
    for event in _some(_scans(messages), rng, float(rng.choice([0.2, 1.0]))):
        messages.events.append(BagMessage(SCAN, event.log_ns + 1, event.body, event.true_ns))
    messages.events.sort(key=lambda event: event.log_ns)


@messages_fault(2, "lidar", "stick|stuck|frozen|same|repeat|twice")
def the_lidar_sticks(messages: Messages, rng: Rng) -> None:
    scans = _scans(messages)
    first, count = int(rng.integers(40, 110)), int(rng.integers(5, 40))
    for event in scans[first : first + count]:
        event.body.ranges = scans[first].body.ranges.copy()


@messages_fault(2, "lidar", "order|stamp|sort|back")
def scans_are_out_of_order(messages: Messages, rng: Rng) -> None:
    for event in _scans(messages):
        event.log_ns += int(rng.integers(0, SECOND))
    messages.events.sort(key=lambda event: event.log_ns)


@messages_fault(2, "lidar", "beams|sector|distance|view|side|no return")
def a_sector_is_blind(messages: Messages, rng: Rng) -> None:
    width, first = int(rng.choice([60, 120, 165])), int(rng.integers(180))
    where = (first + np.arange(width)) % 180
    for event in _scans(messages):
        event.body.ranges[where] = float(rng.choice([math.inf, 0.0]))


@messages_fault(2, ("lidar", "mount"), "units?|millimet|centimet|scale|heights?", clouds=True)
def cloud_is_in_other_units(messages: Messages, rng: Rng) -> None:
    unit = float(rng.choice([1000.0, 100.0]))
    for event in messages.of("/cloud"):
        table = event.body.data.view("<f4").reshape(-1, 4).copy()
        table[:, :3] *= unit
        event.body.data = table.reshape(-1).view(np.uint8)


@messages_fault(2, "lidar", "times?\\b|points?|clock", clouds=True)
def cloud_times_are_wrong(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(4))
    for event in messages.of("/cloud"):
        table = event.body.data.view("<f4").reshape(-1, 4).copy()
        table[:, 3] = [1e9, 1e3, -1.0, 0.0][which] * table[:, 3] if which != 2 else table[:, 3] - np.float32(PERIOD_S)
        event.body.data = table.reshape(-1).view(np.uint8)


@messages_fault(2, "lidar", "sizes?|damaged|contradict|bytes|point_step|fields?", clouds=True)
def cloud_sizes_contradict_the_data(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(5))
    for event in _some(messages.of("/cloud"), rng):
        body = event.body
        if which == 0:
            body.width = 4_000_000_000
        elif which == 1:
            body.point_step = 0
        elif which == 2:
            body.data = body.data[: len(body.data) // 2]
        elif which == 3:
            body.fields = body.fields[:1]
        else:
            body.fields[1].offset = 4000


@messages_fault(2, "lidar", "nan|finite|far|wild|beyond", clouds=True)
def cloud_has_wild_points(messages: Messages, rng: Rng) -> None:
    value, share = float(rng.choice([math.nan, math.inf, 1e20, 1e5])), float(rng.choice([0.01, 0.3]))
    for event in messages.of("/cloud"):
        table = event.body.data.view("<f4").reshape(-1, 4).copy()
        table[rng.random(len(table)) < share, :2] = value
        event.body.data = table.reshape(-1).view(np.uint8)


LIDAR_FAULTS = faults_of(globals())
