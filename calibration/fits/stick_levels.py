"""The levels of a sweep, one axis at a time: dead band edges, direction and monotony."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.fits.drive_log import Holds, SweepLog, steady_holds
from waychair.calibration.fits.fit_steps import AXES
from waychair.errors import CalibrationError, NotMonotone, ThinData
from waychair.types import FloatArray

MOVING = (0.015, 0.025)
"""m/s, rad/s; an axis moves if a hold's mean speed is higher."""

_FALLS = (0.05, 0.10)  # m/s, rad/s; a larger drop below the speed of a smaller level is not noise


@dataclass(frozen=True, slots=True)
class SweepLevel:
    """One level of an axis alone: volts, number of holds, and median speed [m/s] or [rad/s]."""

    volts: float
    repetitions: int
    speed: float


@dataclass(frozen=True, slots=True)
class SideLevels:
    """One side of an axis from its levels, in volts beyond neutral and speeds, all positive.

    `direction` is 1 above neutral and -1 below; `sign` is that of the speeds there. The axis rests at `still` and moves
    at `moving`; `edge` is half-way between. `farthest` is the farthest level; `gain` and `limit` are first guesses.
    """

    axis: int
    direction: int
    sign: int
    still: float
    edge: float
    moving: float
    farthest: float
    gain: float
    limit: float


def refuse_creeping(log: SweepLog, neutral: tuple[float, float], near: float) -> None:
    """Raise `CalibrationError` if the chair moves at its neutral, or is never at neutral between its levels."""
    there = (np.abs(log.volts - np.asarray(neutral)) <= near).all(axis=1)
    leaving = np.flatnonzero(there[:-1] & ~there[1:])
    advice = "measure it again on the original stick at rest"
    if not len(leaving):
        raise CalibrationError(f"the chair is never at its neutral of {neutral[0]:.3f}, {neutral[1]:.3f} V: {advice}")
    # Signed, so that noise and the last motion from levels to either side cancel out.
    creeping = np.median([log.twists[max(k - 4, 0) : k + 1].mean(axis=0) for k in leaving], axis=0)
    for axis, last in enumerate(np.abs(creeping).tolist()):
        if last > MOVING[axis]:
            raise CalibrationError(
                f"the {AXES[axis]} axis still moves at its neutral of {neutral[axis]:.3f} V, by {last:.3f}: {advice}"
            )


def sweep_levels(holds: Holds, axis: int, neutral: tuple[float, float], near: float) -> tuple[SweepLevel, ...]:
    """Return the levels of an axis (0 forward, 1 turn) by rising volts, from holds with the other axis `near`
    neutral."""
    other = 1 - axis
    alone = np.abs(holds.volts[:, other] - neutral[other]) <= near
    volts, speeds = holds.volts[alone, axis], holds.twists[alone, axis]
    levels = []
    for value in np.unique(volts):
        held = speeds[volts == value]
        levels.append(SweepLevel(float(value), len(held), float(np.median(held))))
    return tuple(levels)


def sides_of(levels: tuple[SweepLevel, ...], axis: int, neutral: float) -> tuple[SideLevels, SideLevels]:
    """Return the sides of an axis above and below neutral.

    Raises:
        CalibrationError: the axis drives the same way on both sides.
        NotMonotone: more stick gives less speed.
        ThinData: a side does not move, or has too few levels that do.
    """
    above, below = _side(levels, axis, neutral, 1), _side(levels, axis, neutral, -1)
    if above.sign == below.sign:
        raise CalibrationError(
            f"the {AXES[axis]} axis drives the same way on both sides of its neutral of {neutral:.3f} V: measure the "
            "neutral again, and check that speeds have their signs"
        )
    return above, below


def _side(levels: tuple[SweepLevel, ...], axis: int, neutral: float, direction: int) -> SideLevels:
    where = f"{AXES[axis]} axis {'above' if direction > 0 else 'below'} neutral"
    here = sorted((direction * (level.volts - neutral), level.speed) for level in levels)
    beyond = np.array([row[0] for row in here])
    speeds = np.array([row[1] for row in here])
    beyond, speeds = beyond[beyond > 0.0], speeds[beyond > 0.0]
    sign = -1 if len(speeds) and speeds[np.abs(speeds).argmax()] < 0.0 else 1
    amounts = sign * speeds
    moving = np.flatnonzero(amounts > MOVING[axis])
    if len(moving) < 2:
        raise ThinData(f"only {len(moving)} levels of the {where} move the chair: sweep farther")
    _refuse_falling(where, axis, beyond, amounts)
    first = int(moving[0])
    still = float(beyond[first - 1]) if first else 0.0
    edge, limit, farthest = 0.5 * (still + float(beyond[first])), float(amounts.max()), float(beyond[-1])
    middle = int(moving[len(moving) // 2])
    return SideLevels(
        axis=axis,
        direction=direction,
        sign=sign,
        still=still,
        edge=edge,
        moving=float(beyond[first]),
        farthest=farthest,
        gain=float(amounts[middle]) / max(float(beyond[middle]) - edge, 1e-3),
        limit=limit,
    )


def _refuse_falling(where: str, axis: int, beyond: FloatArray, amounts: FloatArray) -> None:
    around = np.pad(amounts, 1, mode="edge")
    smooth = np.median([around[:-2], amounts, around[2:]], axis=0)  # a single wrong level is no fall
    fastest = np.maximum.accumulate(smooth)
    falls = fastest - smooth
    worst = int(falls.argmax())
    if falls[worst] > max(_FALLS[axis], 0.05 * float(fastest[-1])):
        raise NotMonotone(
            f"the {where} gives {smooth[worst]:.3f} at {beyond[worst]:.3f} V but {fastest[worst]:.3f} at fewer volts: "
            "charge the battery, let the motors cool, keep to one drive profile, and sweep again"
        )


BLOCKS_MEASURE_S, BLOCKS_LEVELS = 0.5, 10
"""s, count; on blocks: last part of each hold that is averaged, and fewest levels on each axis alone."""


@dataclass(frozen=True, slots=True)
class OnBlocks:
    """One axis as raised wheels show it: its direction and both dead bands [V], but no speeds on the floor."""

    neutral: float
    sign: int
    dead_band_above: float
    dead_band_below: float


def on_blocks(log: SweepLog, neutral: tuple[float, float], near: float) -> tuple[OnBlocks, OnBlocks]:
    """Return neutral, direction and dead bands of both axes from a sweep with raised wheels.

    The speeds are without load and ground, so only motion and its direction are used.

    Raises:
        ThinData, NotMonotone, CalibrationError: as `sides_of` and `refuse_creeping`; fewer levels than `BLOCKS_LEVELS`.
    """
    refuse_creeping(log, neutral, near)
    holds = steady_holds(log, BLOCKS_MEASURE_S, (0.3, 1.0))
    found = []
    for axis in (0, 1):
        levels = sweep_levels(holds, axis, neutral, near)
        if len(levels) < BLOCKS_LEVELS:
            raise ThinData(f"{len(levels)} levels on the {AXES[axis]} axis are too few: drive {BLOCKS_LEVELS}")
        above, below = sides_of(levels, axis, neutral[axis])
        found.append(OnBlocks(neutral[axis], above.sign, above.edge, below.edge))
    return found[0], found[1]
