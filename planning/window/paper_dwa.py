"""The dynamic window exactly as the source paper prints it: a baseline, driven behind limiter and collision monitor.

Eqs. (8)-(11) of the source paper (intelligent wheelchair, D* Lite and DWA), all weights 1. Its gaps are filled so:

- v_min of Eq. (8) is 0. Since dist and vel count backwards as forwards, a chair at rest would otherwise back off.
- Eq. (9) is centred on the measured speed. With a short window a chair with a dead band never starts: its drive ignores
  the small commands, and the next window is centred on the same standstill.
- Eq. (10) compares omega with sqrt(2 dist brake), dist in metres: the units do not match. As printed, turning on the
  spot is never admissible, since such an arc has no length. None of the equations knows the chair's outline, its
  reaction time or the distance driven until the next command.
- eta of Eq. (11) normalises; the paper does not say how. Here each term is divided by its sum over the admissible
  candidates (as in Fox, Burgard and Thrun 1997); a term that is 0 for all of them, 0/0, contributes 0.

The chair itself is driven by `dwa.choose` and along lines; the setting `chair.navigator.window: paper` drives it by these
equations, up to the last metre of a leg, for comparison.
"""

from __future__ import annotations

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arcs, compose, wrap_angles
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.arc_fan import free_times
from waychair.planning.body.footprint import footprint, in_cells
from waychair.planning.window.dwa import HORIZON, OMEGA_SAMPLES, V_SAMPLES, DwaResult
from waychair.planning.window.dwa_kernels import local_section
from waychair.planning.window.motion_limits import PERIOD, DwaSettings, braking
from waychair.types import BoolArray, FloatArray, Path, Pose2, Twist


def choose_as_paper(
    pose: Pose2,
    measured: Twist,
    path: Path,
    distances: DistanceField,
    body: ChairBody,
    settings: DwaSettings,
) -> DwaResult:
    """Return the next command towards the path by the paper's equations.

    pose: map_from_base. measured: the present speed. path: in map; the target is its point as far ahead as the fastest
    arc reaches. distances: around the chair, in map. Speeds and accelerations are the settings', samples and horizon
    those of `dwa`, Delta t is `PERIOD`. `blocked` when nothing is admissible.
    """
    candidates = window(measured, settings)
    section, _ = local_section(path.poses, pose.array(), settings.max_speed * HORIZON)
    shape = footprint(body, 0.0, distances)
    certain = np.full(len(candidates), HORIZON)
    seconds = free_times(shape, in_cells(distances, pose), candidates, certain, HORIZON)
    v, omega = candidates.T
    dist = v * seconds
    admissible: BoolArray = v <= np.sqrt(2 * dist * settings.braking)
    admissible &= np.abs(omega) <= np.sqrt(2 * dist * settings.alpha)
    ends = compose(pose.array(), arcs(v * HORIZON, omega * HORIZON))
    bearing = np.arctan2(section[-1, 1] - ends[:, 1], section[-1, 0] - ends[:, 0])
    heading = np.pi - np.abs(wrap_angles(bearing - ends[:, 2]))
    scores = np.where(admissible, score((heading, dist, v), admissible), -np.inf)
    if not admissible.any():
        return DwaResult(braking(measured, settings), candidates, scores, pose.array()[None], blocked=True)
    best = int(np.argmax(scores))
    times = np.linspace(0.0, HORIZON, 26)
    arc = compose(pose.array(), arcs(v[best] * times, omega[best] * times))
    return DwaResult(Twist(float(v[best]), float(omega[best])), candidates, scores, arc)


def window(measured: Twist, settings: DwaSettings) -> FloatArray:
    """Return (N, 2) candidates: the intersection of Eqs. (8) and (9)."""
    s, dt = settings, PERIOD
    v = np.linspace(
        max(0.0, measured.v - s.braking * dt),
        max(0.0, measured.v - s.braking * dt, min(s.max_speed, measured.v + s.acceleration * dt)),
        V_SAMPLES,
    )
    omega = np.linspace(
        max(-s.max_omega, measured.omega - s.alpha * dt),
        min(s.max_omega, measured.omega + s.alpha * dt),
        OMEGA_SAMPLES,
    )
    return np.stack(np.meshgrid(v, omega), axis=-1).reshape(-1, 2)


def score(
    terms: tuple[FloatArray, FloatArray, FloatArray],
    admissible: BoolArray,
    weights: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> FloatArray:
    """Return (N,) Eq. (11): alpha heading + beta dist + gamma vel, terms (N,) normalised over the admissible ones."""
    total = np.zeros(len(admissible))
    for weight, term in zip(weights, terms, strict=True):
        whole = term[admissible].sum()
        if whole > 0:
            total += weight * term / whole
    return total
