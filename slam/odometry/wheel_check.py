"""Check of wheel odometry: its headings, positions and speeds against the scans and each other."""

from __future__ import annotations

import math

import numpy as np

from waychair.slam.odometry.aid_evidence import (
    DEGREES,
    ENOUGH_TURN,
    GOOD,
    LEAST_CORRELATION,
    Evidence,
    Stretch,
    delay_of,
    factors,
    unlike,
)
from waychair.slam.odometry.aid_findings import AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ScanSeries, WheelSeries, correlation, robust_slope
from waychair.slam.odometry.aid_windows import turn_agreement, way_agreement
from waychair.types import BoolArray, FloatArray

_LEAST_SCALE, _LEAST_GAIN = 0.015, 0.25  # wheels this wrong are corrected where it moves the map by so much [m]
_NOTED_SCALE = 0.01  # wheels that are longer or shorter by this share than the scans are worth a note
_SIGMAS = 4.0
_DOUBT = 2.0  # sigma by which a scale must exceed the noted one: sound wheels are up to a hundredth long
_LEAST_MOVED = 0.3  # [m] or [rad] of a chair whose wheels are silent
_LEAST_AWAY, _CREEP = 0.4, 0.05  # [m] or [rad], and per second; the same for wheels whose readings stay the same
_MEASURED = 0.7  # share of a stretch that scans must measure; along a corridor they do not
_MOST_STUCK = 0.5  # share of the recording; wheels that stand still for longer are judged as a whole
_LEAST_INTERVALS = 5  # fewer tell no correction
_LEAST_FACTOR = 1e-4  # ways that are smaller are none
_LEAST_ANGLE = math.radians(10.0)  # ways that are turned by less are not
_STANDS = 0.05  # share of the true way below which wheels stand still

_Corrected = tuple[FloatArray, Cause, float]  # ways (N, 2), what was wrong with them, and by how much


def check_wheels(
    evidence: Evidence, wheels: WheelSeries, told: FloatArray, gyro: FloatArray | None
) -> tuple[FloatArray | None, float]:
    """Return the motions (N, 3) in place of the told ones, None where these hold; and the share that is from scans."""
    scans = evidence.scans
    driven = wheels.driven(scans.intervals)
    delay = delay_of(evidence, lambda late: wheels.motions(scans.intervals, late)[:, 2])
    base = told
    if delay:
        evidence.add(AidPart.WHEELS, AidState.CORRECTED, Cause.DELAY, None, value=delay)
        base, driven = wheels.motions(scans.intervals, delay), wheels.driven(scans.intervals, delay)
        lost = ~np.isfinite(base[:, 2])
        base[lost] = told[lost]
    filled, by_scans = scans.filled(), 0.0
    silent = _without_gaps(evidence, wheels, base, filled)
    used = base.copy()
    turn_runs = evidence.runs(evidence.turn(base[:, 2]))
    whole = _corrected_turns(evidence, base[:, 2], evidence.whole()) if turn_runs else None
    if whole is not None:
        turn_runs, used[:, 2] = [], whole
    wrong_heading = np.zeros(len(used), np.bool_)
    for run in turn_runs:
        inside = run.inside
        turns, fitted = _fitted_turns(evidence, base[:, 2], driven[:, 2], gyro, filled[:, 2], run)
        used[inside, 2] = turns[inside]
        wrong_heading |= inside & (not fitted)
    ways = np.where(wrong_heading[:, None], _lengths(base, driven), base[:, :2])
    way_runs = evidence.runs(evidence.way(ways))
    whole_way = _corrected_ways(evidence, wheels, ways, evidence.whole()) if way_runs else None
    if whole_way is not None:
        way_runs, used[:, :2] = [], whole_way
    for run in way_runs:
        inside = run.inside
        found, measured = _fitted_ways(evidence, wheels, ways, driven, filled, run)
        used[inside, :2] = found[inside]
        by_scans += float(inside.mean()) if measured else 0.0
    if wrong_heading.any():
        inside = wrong_heading & ~np.any([run.inside for run in way_runs], axis=0) if way_runs else wrong_heading
        used[inside, :2] = ways[inside]
    if silent or turn_runs or way_runs or delay or whole is not None or whole_way is not None:
        return used, by_scans
    return _scaled(evidence, base), 0.0


def _without_gaps(evidence: Evidence, wheels: WheelSeries, motions: FloatArray, filled: FloatArray) -> bool:
    """Put the motions of the scans into stretches in which the chair moves, but readings are missing or stay the same.

    The stretches are noted.
    """
    intervals = evidence.scans.intervals
    missing, stuck = wheels.missing(intervals), wheels.stuck(intervals)
    found = False
    for first, end in _runs_of(missing):
        moved = np.abs(filled[first:end])
        if moved[:, :2].sum() + moved[:, 2].sum() >= _LEAST_MOVED:
            _stand_in(evidence, motions, filled, first, end, Cause.MISSING)
            found = True
    for first, end in _runs_of(stuck & ~missing) if stuck.mean() < _MOST_STUCK else ():
        away = _measured_away(evidence.scans, first, end)
        # noise of scans adds up while a chair stands
        if away >= _LEAST_AWAY + _CREEP * (intervals[end - 1, 1] - intervals[first, 0]):
            _stand_in(evidence, motions, filled, first, end, Cause.STUCK)
            found = True
    return found


def _measured_away(scans: ScanSeries, first: int, end: int) -> float:
    """Return how far [m] or [rad] the chair gets in a stretch by the motions that scans measure, if they measure most."""
    away = 0.0
    for columns, known in (((0, 1), scans.way_known), ((2,), scans.turn_known)):
        own = known[first:end]
        if own.mean() >= _MEASURED:
            moved = np.where(own[:, None], scans.motions[first:end][:, columns], 0.0)
            away = max(away, float(np.abs(np.cumsum(moved, axis=0)).max()))
    return away


def _runs_of(mask: BoolArray) -> list[tuple[int, int]]:
    """Return the first index and the end of each run of a mask (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int64), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _stand_in(
    evidence: Evidence, motions: FloatArray, filled: FloatArray, first: int, end: int, cause: Cause
) -> None:  # fmt: skip
    """Put the motions (N, 3) of the scans in place of the wheels' between two intervals, and note it."""
    intervals = evidence.scans.intervals
    motions[first:end] = filled[first:end]
    inside = np.zeros(len(motions), np.bool_)
    inside[first:end] = True
    since, until = float(intervals[first, 0]), float(intervals[end - 1, 1])
    run = Stretch(inside, since if first else None, until if end < len(motions) else None)
    evidence.add(AidPart.WHEELS, AidState.LEFT_OUT, cause, run)


def speeds_are_wrong(evidence: Evidence, motions: FloatArray, driven: FloatArray) -> bool:
    """Note that the twists contradict the motions (N, 3) in use; twists of zero matter only where scans are swept."""
    silent = not np.abs(driven[np.isfinite(driven)]).any()
    if silent and evidence.scans.sweep_s == 0.0:
        return False
    finite: BoolArray = np.asarray(np.isfinite(np.hstack([motions, driven])).all(axis=1))
    turns = turn_agreement(evidence.spans, driven[:, 2], np.nan_to_num(motions[:, 2]), finite)
    ways = way_agreement(evidence.spans, driven[:, :2], np.nan_to_num(motions[:, :2]), finite)
    for found, told, true in ((ways, driven[:, 0], motions[:, 0]), (turns, driven[:, 2], motions[:, 2])):
        if found.share > 0.5 and found.evidence > ENOUGH_TURN:
            factor = float(np.abs(told[finite]).sum() / max(float(np.abs(true[finite]).sum()), 1e-9))
            evidence.add(
                AidPart.TWIST, AidState.CORRECTED, Cause.NOTHING if silent else Cause.SCALE, None, value=factor
            )
            return True
    return False


def _fitted_turns(
    evidence: Evidence, told: FloatArray, driven: FloatArray, gyro: FloatArray | None, filled: FloatArray,
    run: Stretch,
) -> tuple[FloatArray, bool]:  # fmt: skip
    """Return the turns to use in a stretch, and whether they follow from the told headings."""
    corrected = _corrected_turns(evidence, told, run)
    if corrected is not None:
        return corrected, True
    known, reference = evidence.known_turn & run.inside, evidence.turns
    size, true = float(np.nansum(np.abs(told[known]))), float(np.abs(reference[known]).sum())
    look = unlike(told[known] / evidence.scans.seconds[known], size, true)
    look = Cause.UNLIKE if look is Cause.STUCK else look  # a heading that turns evenly is that of a wrong wheel
    evidence.add(AidPart.WHEEL_TURN, AidState.LEFT_OUT, look, run, value=size / max(true, 1e-9))
    for other in (driven, gyro):
        if other is not None and turn_agreement(evidence.spans, other, reference, known).share <= GOOD:
            return np.where(np.isfinite(other), other, filled), False
    return filled, False


def _corrected_turns(evidence: Evidence, told: FloatArray, run: Stretch) -> FloatArray | None:
    """Return the turns (N,) corrected by a factor, and note it; None where no factor makes them agree."""
    known, reference = evidence.known_turn & run.inside & np.isfinite(told), evidence.turns
    if abs(correlation(told, reference, known)) <= LEAST_CORRELATION:
        return None
    solution, sigma = robust_slope(told[known], reference[known])
    for scale in factors(float(solution[0]), float(sigma[0])):
        after = turn_agreement(evidence.spans, told / scale, reference, known)
        if after.share <= GOOD and not evidence.runs(after):
            cause = Cause.OTHER_WAY if scale < 0.0 else Cause.DEGREES if abs(scale - DEGREES) < 1e-6 else Cause.SCALE
            evidence.add(AidPart.WHEEL_TURN, AidState.CORRECTED, cause, run, value=scale, sigma=float(sigma[0]))
            return told / scale
    return None


def _lengths(told: FloatArray, driven: FloatArray) -> FloatArray:
    """Return ways (N, 2) of poses whose headings are wrong: their lengths, forward unless the twist says backward."""
    size = np.hypot(told[:, 0], told[:, 1])
    return np.stack([np.where(driven[:, 0] < 0.0, -size, size), np.zeros_like(size)], axis=1)


def _fitted_ways(
    evidence: Evidence, wheels: WheelSeries, told: FloatArray, driven: FloatArray,
    filled: FloatArray, run: Stretch,
) -> tuple[FloatArray, bool]:  # fmt: skip
    """Return the ways (N, 2) to use in a stretch, and whether they come from the scans."""
    corrected = _corrected_ways(evidence, wheels, told, run)
    if corrected is not None:
        return corrected, False
    known, reference = _known_ways(evidence, told, run), evidence.scans.motions[:, :2]
    size, true = float(np.hypot(*told[known].T).sum()), float(np.hypot(*reference[known].T).sum())
    cause = Cause.NOTHING if size < _STANDS * true else Cause.UNLIKE
    evidence.add(AidPart.WHEEL_WAY, AidState.LEFT_OUT, cause, run, value=size / max(true, 1e-9))
    forward = driven[:, :2]
    if (
        way_agreement(evidence.spans, forward, reference, known).share <= GOOD
        and np.abs(forward[known]).sum() > 0.5 * true
    ):
        return forward, False
    return filled[:, :2], True


def _known_ways(evidence: Evidence, told: FloatArray, run: Stretch) -> BoolArray:
    known: BoolArray = evidence.known_way & run.inside & np.isfinite(told).all(axis=1)
    return known


def _corrected_ways(evidence: Evidence, wheels: WheelSeries, told: FloatArray, run: Stretch) -> FloatArray | None:
    """Return the ways (N, 2) corrected by a factor, a rotation or a reflection, and note it; None where none fits."""
    known, reference = _known_ways(evidence, told, run), evidence.scans.motions[:, :2]
    if known.sum() < _LEAST_INTERVALS:
        return None
    for found, cause, value in (
        *_in_base(told, reference, known, run),
        *_in_odom(wheels, evidence, told, reference, known),
    ):
        after = way_agreement(evidence.spans, found, reference, known)
        if after.share <= GOOD and not evidence.runs(after):
            evidence.add(AidPart.WHEEL_WAY, AidState.CORRECTED, cause, run, value=value)
            return found
    return None


def _in_base(told: FloatArray, reference: FloatArray, known: BoolArray, run: Stretch) -> list[_Corrected]:
    """Return the ways corrected by a factor and a rotation in the base's axes."""
    fitted, angle = _similarity(told[known], reference[known], 1.0)
    if fitted < _LEAST_FACTOR:
        return []
    tried = factors(fitted, 0.0)
    if abs(angle) < _LEAST_ANGLE:
        return [(told / factor, _unit_cause(factor), factor) for factor in tried]
    if abs(abs(angle) - math.pi) < _LEAST_ANGLE:
        return [(told / -factor, Cause.BACKWARD, factor) for factor in tried]
    if run.since_s is not None or run.until_s is not None:
        return []  # axes do not change on the way: poses that drift look like that for a while
    return [(_rotated(told, -angle) / factor, Cause.AXES, math.degrees(angle)) for factor in tried]


def _in_odom(
    wheels: WheelSeries, evidence: Evidence, told: FloatArray, reference: FloatArray, known: BoolArray
) -> list[_Corrected]:
    """Return the ways corrected by a reflection in the axes of odom, as where x and y are exchanged."""
    middle = np.interp(evidence.scans.intervals.mean(axis=1), wheels.times, np.unwrap(wheels.poses[:, 2]))
    in_odom = _rotated(told, middle)
    fitted, angle = _similarity(in_odom[known], _rotated(reference[known], middle[known]) * (1.0, -1.0), 1.0)
    if fitted < _LEAST_FACTOR:
        return []
    mirrored = _rotated(_rotated(in_odom, -angle) * (1.0, -1.0), -middle)
    return [(mirrored / factor, Cause.EXCHANGED, factor) for factor in factors(fitted, 0.0)]


def _rotated(ways: FloatArray, angle: FloatArray | float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * ways[:, 0] - s * ways[:, 1], s * ways[:, 0] + c * ways[:, 1]], axis=1)


def _similarity(told: FloatArray, reference: FloatArray, floor: float) -> tuple[float, float]:
    """Return the factor and the angle [rad] by which told ways (N, 2) follow from others, by least absolute deviations."""
    first, second = told @ (1.0, 1j), reference @ (1.0, 1j)
    weights, ratio = np.ones(len(told)), 0j
    for _ in range(8):
        ratio = complex(
            (weights * first * second.conj()).sum() / max(float((weights * np.abs(second) ** 2).sum()), 1e-12)
        )
        off = np.abs(first - ratio * second)
        weights = 1.0 / np.maximum(off, max(1e-9, 0.3 * floor * float(np.median(off))))
    return abs(ratio), float(np.angle(ratio))


def _scaled(evidence: Evidence, told: FloatArray) -> FloatArray | None:
    """Return the motions with the wheels' scale corrected, if that moves the map: where no scan measures the way.

    Elsewhere a scale that differs from the scans' is noted only: neither is known to be the right one.
    """
    known = evidence.known_way & np.isfinite(told).all(axis=1)
    gained = np.gradient(told[:, 0]) if len(told) > 1 else np.zeros(len(told))
    moving = known & (np.abs(evidence.scans.motions[:, 0]) > 0.03) & np.isfinite(gained)
    if moving.sum() < 20:
        return None
    # a lidar beside the base drives another way in turns; and a swept scan sees the chair a little later than its stamp
    extra = np.column_stack([evidence.scans.motions[moving, 2], gained[moving]])
    solution, sigma = robust_slope(told[moving, 0], evidence.scans.motions[moving, 0], extra)
    factor, one_sigma = float(solution[0]), float(sigma[0])
    if abs(factor - 1.0) < max(_NOTED_SCALE, _SIGMAS * one_sigma) or factor < 0.5:
        return None
    length, longest = 0.0, 0.0
    for is_known, way in zip(evidence.known_way.tolist(), np.abs(told[:, 0]).tolist(), strict=True):
        length = 0.0 if is_known else length + way
        longest = max(longest, length)
    gain = abs(1.0 - 1.0 / factor) * longest
    if gain < _LEAST_GAIN or abs(factor - 1.0) < _LEAST_SCALE:
        if abs(factor - 1.0) - _DOUBT * one_sigma < _NOTED_SCALE:
            return None
        evidence.add(AidPart.SCALES, AidState.NOTED, Cause.SCALES_DIFFER, None, value=factor, sigma=one_sigma)
        return None
    evidence.add(AidPart.WHEEL_WAY, AidState.CORRECTED, Cause.LONG, None, value=factor, sigma=one_sigma, gain_m=gain)
    return np.column_stack([told[:, :2] / factor, told[:, 2]])


def _unit_cause(factor: float) -> Cause:
    if abs(factor - 1000.0) < 1e-6:
        return Cause.MILLIMETRES
    return Cause.CENTIMETRES if abs(factor - 100.0) < 1e-6 else Cause.SCALE
