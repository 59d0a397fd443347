"""Bundle adjustment: the poses of key frames and positions of landmarks that fit all observations best.

Levenberg-Marquardt with the landmarks eliminated (Schur complement; Triggs et al., Bundle adjustment - a modern
synthesis, 2000, section 6), Huber's weights, and a dense solution of the reduced equations: suited to windows of some
tens of key frames, and fast enough for some hundreds once at the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.slam.camera.reprojection import HUBER_WIDTH, NoiseModel, huber_loss, move_kernel, residual_kernel
from waychair.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle adjustment problem.

    camera_from_map of K key frames: `rotations` (K, 3, 3), `translations` (K, 3); only those with `free` (K,) move.
    `landmarks` (L, 3) [m]. E observations: `frame` (E,), `landmark` (E,) ascending, and `observed` (E, 4): u, v [px],
    1/z [1/m] or nan, and the factor on the pixel's error.
    """

    rotations: FloatArray
    translations: FloatArray
    free: BoolArray
    landmarks: FloatArray
    frame: IntArray
    landmark: IntArray
    observed: FloatArray


def adjust(bundle: Bundle, camera: FloatArray, noise: NoiseModel, iterations: int = 6) -> tuple[Bundle, FloatArray]:
    """Return the adjusted bundle, and the chi-square (E,) of each pixel (inf behind the camera)."""
    turns, shifts, points = bundle.rotations.copy(), bundle.translations.copy(), bundle.landmarks.copy()
    sigma = np.array([noise.pixel, noise.inverse_depth, HUBER_WIDTH])
    slots = np.where(bundle.free, np.cumsum(bundle.free) - 1, -1).astype(np.int64)
    starts = np.searchsorted(bundle.landmark, np.arange(len(points) + 1)).astype(np.int64)
    sightings = (bundle.frame, starts, np.ascontiguousarray(bundle.observed))
    chi, cost = chi_kernel(turns, shifts, points, *sightings, camera, sigma)
    damping = 1e-4
    for _ in range(iterations):
        reduced, gradient, inverses, pulls, couplings = reduce_kernel(
            turns, shifts, points, slots, *sightings, camera, sigma, damping
        )
        try:
            steps = np.asarray(-np.linalg.solve(reduced, gradient), np.float64).reshape(-1, 6)
        except np.linalg.LinAlgError:
            break
        trial = turns.copy(), shifts.copy(), points.copy()
        step_kernel(*trial, slots, *sightings[:2], steps, inverses, pulls, couplings)
        trial_chi, now = chi_kernel(*trial, *sightings, camera, sigma)
        if now < cost:
            gained, cost, damping = cost - now, now, max(damping * 0.2, 1e-8)
            (turns, shifts, points), chi = trial, trial_chi
            if gained < 1e-4 * cost:
                break
        else:
            damping *= 10.0
    adjusted = Bundle(
        rotations=turns,
        translations=shifts,
        free=bundle.free,
        landmarks=points,
        frame=bundle.frame,
        landmark=bundle.landmark,
        observed=bundle.observed,
    )
    return adjusted, chi


@njit(cache=True)
def chi_kernel(
    turns: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    frame: IntArray,
    starts: IntArray,
    observed: FloatArray,
    camera: FloatArray,
    sigma: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the chi-square (E,) of each pixel, inf behind the camera, and the sum of all Huber losses.

    An observation behind the camera costs as much as an error of ten sigma.
    """
    error, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    chi, cost = np.empty(len(frame)), 0.0
    for n in range(len(points)):
        for e in range(starts[n], starts[n + 1]):
            k = frame[e]
            pixel, depth = residual_kernel(
                points[n], observed[e], camera, turns[k], shifts[k], sigma, error, by_pose, by_point
            )
            chi[e] = pixel if pixel >= 0.0 else np.inf
            cost += huber_loss(pixel if pixel >= 0.0 else 100.0, sigma[2]) + huber_loss(depth, sigma[2])
    return chi, cost


@njit(cache=True)
def reduce_kernel(
    turns: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    slots: IntArray,
    frame: IntArray,
    starts: IntArray,
    observed: FloatArray,
    camera: FloatArray,
    sigma: FloatArray,
    damping: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the equations of the F free poses with the landmarks eliminated, and the terms to recover the landmarks.

    Matrix (6F, 6F) and gradient (6F,); inverse blocks (L, 3, 3), gradients (L, 3) and couplings (E, 6, 3).
    """
    size = 6 * (slots.max() + 1)
    reduced, gradient = np.zeros((size, size)), np.zeros(size)
    inverses, pulls = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    couplings = np.zeros((len(frame), 6, 3))
    error, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    for n in range(len(points)):
        block = np.zeros((3, 3))
        for e in range(starts[n], starts[n + 1]):
            k = frame[e]
            pixel, _ = residual_kernel(
                points[n], observed[e], camera, turns[k], shifts[k], sigma, error, by_pose, by_point
            )
            if pixel < 0.0:
                continue
            by_map = by_point @ turns[k]
            for i in range(3):
                for r in range(3):
                    pulls[n, i] += by_map[r, i] * error[r]
                    for j in range(3):
                        block[i, j] += by_map[r, i] * by_map[r, j]
            if slots[k] < 0:
                continue
            at = 6 * slots[k]
            for i in range(6):
                for r in range(3):
                    gradient[at + i] += by_pose[r, i] * error[r]
                    for j in range(6):
                        reduced[at + i, at + j] += by_pose[r, i] * by_pose[r, j]
                    for j in range(3):
                        couplings[e, i, j] += by_pose[r, i] * by_map[r, j]
        for i in range(3):
            block[i, i] += damping * block[i, i] + 1e-9
        inverses[n] = np.linalg.inv(block)
    for i in range(size):
        reduced[i, i] += damping * reduced[i, i] + 1e-9
    eliminate_kernel(reduced, gradient, slots, frame, starts, inverses, pulls, couplings)
    return reduced, gradient, inverses, pulls, couplings


@njit(cache=True)
def eliminate_kernel(
    reduced: FloatArray,
    gradient: FloatArray,
    slots: IntArray,
    frame: IntArray,
    starts: IntArray,
    inverses: FloatArray,
    pulls: FloatArray,
    couplings: FloatArray,
) -> None:
    """Eliminate the landmarks from the equations of the poses in place (Schur complement)."""
    for n in range(len(pulls)):
        for e in range(starts[n], starts[n + 1]):
            at = 6 * slots[frame[e]]
            if at < 0:
                continue
            half = couplings[e] @ inverses[n]
            for i in range(6):
                for r in range(3):
                    gradient[at + i] -= half[i, r] * pulls[n, r]
            for f in range(starts[n], starts[n + 1]):
                to = 6 * slots[frame[f]]
                if to < 0:
                    continue
                for i in range(6):
                    for j in range(6):
                        total = 0.0
                        for r in range(3):
                            total += half[i, r] * couplings[f, j, r]
                        reduced[at + i, to + j] -= total


@njit(cache=True)
def step_kernel(
    turns: FloatArray,
    shifts: FloatArray,
    points: FloatArray,
    slots: IntArray,
    frame: IntArray,
    starts: IntArray,
    steps: FloatArray,
    inverses: FloatArray,
    pulls: FloatArray,
    couplings: FloatArray,
) -> None:
    """Move free poses by steps (F, 6), and landmarks by the steps that follow, in place."""
    for n in range(len(points)):
        pull = pulls[n].copy()
        for e in range(starts[n], starts[n + 1]):
            slot = slots[frame[e]]
            if slot >= 0:
                for j in range(3):
                    for i in range(6):
                        pull[j] += couplings[e, i, j] * steps[slot, i]
        points[n] -= inverses[n] @ pull
    for k in range(len(slots)):
        if slots[k] >= 0:
            move_kernel(turns[k], shifts[k], steps[slots[k]])
