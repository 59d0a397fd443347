"""The dynamic window exactly as the source paper prints it: the preset to compare with, behind limiter and monitor.

Eqs. (8)-(11) of the source paper (intelligent wheelchair, D* Lite and DWA), all weights 1, with what they leave open:

- v_min of Eq. (8) is taken as 0: with dist and vel as good backwards as forwards, a chair at rest would else back off.
- Eq. (9) lies round the present speed. A chair with a dead band never starts on it where the window's time is short:
  what it offers is swallowed, and the next window lies round the same standstill.
- Eq. (10) compares omega with sqrt(2 dist brake), dist in metres: a speed of turning with a root of rad m. As printed,
  turning in place is never admissible, for a trajectory of no length has no dist; and the outline of the chair, its
  reaction time and the way it makes until the next command are in none of the equations.
- eta of Eq. (11) normalises, the paper does not say how. Here each term is divided by its sum over the admissible
  candidates (Fox, Burgard and Thrun 1997 normalise alike); a term that is 0 for all of them, 0/0, contributes 0.

`dwa.choose` is what the chair drives with.
"""

from __future__ import annotations

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.geometry import arcs, compose, wrap_angles
from waychair.maps.distance_field import DistanceField
from waychair.planning.arc_fan import free_times
from waychair.planning.dwa import DwaResult
from waychair.planning.dwa_kernels import local_section
from waychair.planning.footprint import footprint, in_cells
from waychair.planning.motion import DwaSettings, braking
from waychair.types import BoolArray, FloatArray, Path, Pose2, Twist


def choose_as_paper(
    pose: Pose2,
    measured: Twist,
    path: Path,
    distances: DistanceField,
    body: ChairBody,
    settings: DwaSettings,
) -> DwaResult:
    """The next command towards the path, by the paper's equations.

    pose: map_from_base; measured: the present speed; path: in map, the target is the point as far down it as the
    fastest arc reaches; distances: round the chair, in map. Speeds, accelerations, samples and horizon are those of the
    settings, Delta t is their period. `blocked` when nothing is admissible.
    """
    candidates = window(measured, settings)
    section, _ = local_section(path.poses, pose.array(), settings.max_speed * settings.horizon)
    shape = footprint(body, 0.0, distances)
    certain = np.full(len(candidates), settings.horizon)
    seconds = free_times(shape, in_cells(distances, pose), candidates, certain, settings.horizon)
    v, omega = candidates.T
    dist = v * seconds
    admissible: BoolArray = v <= np.sqrt(2 * dist * settings.braking)
    admissible &= np.abs(omega) <= np.sqrt(2 * dist * settings.alpha)
    ends = compose(pose.array(), arcs(v * settings.horizon, omega * settings.horizon))
    bearing = np.arctan2(section[-1, 1] - ends[:, 1], section[-1, 0] - ends[:, 0])
    heading = np.pi - np.abs(wrap_angles(bearing - ends[:, 2]))
    scores = np.where(admissible, score((heading, dist, v), admissible), -np.inf)
    if not admissible.any():
        return DwaResult(braking(measured, settings), candidates, scores, pose.array()[None], blocked=True)
    best = int(np.argmax(scores))
    times = np.linspace(0.0, settings.horizon, 26)
    arc = compose(pose.array(), arcs(v[best] * times, omega[best] * times))
    return DwaResult(Twist(float(v[best]), float(omega[best])), candidates, scores, arc)


def window(measured: Twist, settings: DwaSettings) -> FloatArray:
    """(N, 2) candidates: Eq. (8) cut with Eq. (9)."""
    s, dt = settings, settings.period
    v = np.linspace(
        max(0.0, measured.v - s.braking * dt),
        min(s.max_speed, measured.v + s.acceleration * dt),
        s.v_samples,
    )
    omega = np.linspace(
        max(-s.max_omega, measured.omega - s.alpha * dt),
        min(s.max_omega, measured.omega + s.alpha * dt),
        s.omega_samples,
    )
    return np.stack(np.meshgrid(v, omega), axis=-1).reshape(-1, 2)


def score(
    terms: tuple[FloatArray, FloatArray, FloatArray],
    admissible: BoolArray,
    weights: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> FloatArray:
    """(N,) Eq. (11): alpha heading + beta dist + gamma vel of terms (N,), each normalised over the admissible ones."""
    total = np.zeros(len(admissible))
    for weight, term in zip(weights, terms, strict=True):
        whole = term[admissible].sum()
        if whole > 0:
            total += weight * term / whole
    return total
