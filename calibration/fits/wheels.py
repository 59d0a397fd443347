"""Radius of each drive wheel and the effective track, from a driven path with known poses.

These are two linear least-squares problems in turn (Antonelli, Chiaverini and Fusco, A calibration method for odometry
of mobile robots based on the least-squares technique, IEEE T-RO 2005). The turn over a stretch is linear in radius over
track of either wheel; with these two known, the distance is linear in the track. As in UMBmark (Borenstein and Feng,
Measurement and correction of systematic odometry errors in mobile robots, IEEE T-RA 1996), a square must be driven both
ways round, because one way alone cannot tell unequal wheels from a wrong track.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationError, ThinData
from waychair.geometry import wrap_angles
from waychair.types import FloatArray, IntArray

_LEAST_TURN = 3.0  # rad, to either side and altogether
_LEAST_WAY = 4.0  # m
_RADII = (0.02, 0.6)
_COUNTS = 2**32


@dataclass(frozen=True, slots=True)
class WheelCalibration(Measured):
    """Effective radii and track, and the rms of the poses' residuals."""

    left_radius: float = measured(0.165, "m", "left drive wheel", low=0.02, high=0.6)
    right_radius: float = measured(0.165, "m", "right drive wheel", low=0.02, high=0.6)
    track: float = measured(0.54, "m", "effective distance between the wheels' contacts", low=0.1, high=1.5)
    rms_m: float = measured(0.0, "m", "of the way over a stretch", low=0.0, high=1.0)
    rms_rad: float = measured(0.0, "rad", "of the turn over a stretch", low=0.0, high=1.0)

    @property
    def radius(self) -> float:
        """Mean radius [m]."""
        return 0.5 * (self.left_radius + self.right_radius)


def wheels_from_drive(ticks: IntArray, poses: FloatArray, ticks_per_turn: int) -> WheelCalibration:
    """Fit the wheels to encoder counts (N, 2), left and right, wrapping at 32 bits, at the poses (N, 3) of the base.

    The chair must turn by less than half a turn between neighbours; about 0.5 s apart is best.

    Raises:
        ThinData: too short a distance, or too little turning to either side.
        CalibrationError: the result is impossible for a chair, because counts and poses do not belong together.
    """
    steps = (np.diff(ticks, axis=0) + _COUNTS // 2) % _COUNTS - _COUNTS // 2
    turned = steps * (2.0 * np.pi / ticks_per_turn)
    turns = wrap_angles(np.diff(poses[:, 2]))
    way = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    _refuse_thin(way, turns)
    over_track, *_ = np.linalg.lstsq(np.stack([-turned[:, 0], turned[:, 1]], axis=1), turns, rcond=None)
    expected = -turned[:, 0] * over_track[0] + turned[:, 1] * over_track[1]
    # With the true turn each stretch is an arc, whose chord is (sum of both wheels) / 2 times the track.
    half = 0.5 * expected
    chord = 0.5 * (turned @ over_track) * np.sinc(half / np.pi)
    heading = poses[:-1, 2] + half
    along = np.stack([chord * np.cos(heading), chord * np.sin(heading)], axis=1).ravel()
    seen = np.diff(poses[:, :2], axis=0).ravel()
    track = float(along @ seen / (along @ along))
    left, right = (float(value) * track for value in over_track)
    if not (all(_RADII[0] <= radius <= _RADII[1] for radius in (left, right)) and 0.1 <= track <= 1.5):
        raise CalibrationError(
            f"radii of {left:.3f} and {right:.3f} m on a track of {track:.3f} m are no wheels of a chair: check the "
            "signs of the encoders, left and right, and that counts and poses belong together"
        )
    return WheelCalibration(
        left_radius=left,
        right_radius=right,
        track=track,
        rms_m=float(np.sqrt(np.mean((along * track - seen) ** 2))),
        rms_rad=float(np.sqrt(np.mean((expected - turns) ** 2))),
    )


def _refuse_thin(way: float, turns: FloatArray) -> None:
    left, right = float(turns[turns > 0.0].sum()), float(-turns[turns < 0.0].sum())
    if way < _LEAST_WAY:
        raise ThinData(f"{way:.1f} m are too short for the wheels' radii: drive at least {_LEAST_WAY:g} m")
    if min(left, right) < _LEAST_TURN:
        raise ThinData(
            f"turns of {left:.1f} rad to the left and {right:.1f} to the right are too few: drive a square both ways "
            "round, or spin to both sides"
        )
