"""Angular synchronisation of planar pose graphs: spectral initialisation, and a proof of a solution's quality.

A planar rotation is a complex number of unit length and a translation a complex number, so that the cost

    F = sum over edges of kappa ||R_j - R_i R_ij||^2 + tau ||t_j - t_i - R_i t_ij||^2

(Rosen, Carlone, Bandeira, Leonard: SE-Sync, IJRR 2019, eq. 10) is one Hermitian form in the stacked translations and
rotations (Carlone, Calafiore, Tommolillo, Dellaert: Planar pose graph optimization, T-RO 2016; Fan et al.: CPL-SLAM,
T-RO 2020). Without the unit lengths its least eigenvector solves it, which gives the initialisation. With them, the Lagrange
multipliers of a solution give a lower bound on the cost of every solution, which is the proof.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from waychair.slam.graph.edges import EdgeArrays
from waychair.types import FloatArray


def sesync_weights(edges: EdgeArrays) -> tuple[FloatArray, FloatArray]:
    """Return kappa (E,) [1/rad^2] and tau (E,) [1/m^2]: the information made isotropic as by SE-Sync's reader."""
    tau = 2.0 / np.trace(np.linalg.inv(edges.information[:, :2, :2]), axis1=1, axis2=2)
    return edges.information[:, 2, 2].copy(), tau


def isotropic(edges: EdgeArrays) -> EdgeArrays:
    """Return the edges with the information whose sum of chi-squares is F to second order (a turn counts twice kappa)."""
    kappa, tau = sesync_weights(edges)
    weights = np.stack([tau, tau, 2 * kappa], axis=1)
    return dataclasses.replace(edges, information=weights[:, :, None] * np.eye(3))


def sesync_objective(poses: FloatArray, edges: EdgeArrays) -> float:
    """Return the cost F (see the module docstring) at poses (N, 3)."""
    kappa, tau = sesync_weights(edges)
    turn, offset = _chordal(poses, edges)
    return float(4 * (kappa * (1 - np.cos(turn))).sum() + (tau * (offset**2).sum(axis=1)).sum())


def spectral_poses(edges: EdgeArrays, count: int) -> FloatArray:
    """Return poses (count, 3) near the optimum of F from the edges alone, node 0 at the origin.

    The rotations are the least eigenvector of F after elimination of the translations, each scaled to unit length.
    Unlike averages of measured rotations (LAGO), it uses the information of translations about headings.
    """
    form = _form(edges, count)[1:, 1:].tocsc()  # node 0 is the origin
    factor = factorised(form)
    inner = count - 1

    def inverse(x: FloatArray) -> FloatArray:
        whole = np.zeros(inner + count, complex)
        whole[inner:] = x.ravel()
        solved: FloatArray = factor.solve(whole)[inner:]
        return solved

    operator = LinearOperator((count, count), inverse, dtype=complex)
    _, vectors = eigsh(operator, k=1, which="LM", v0=np.ones(count, complex), tol=1e-4)
    turns = vectors[:, 0] / np.maximum(np.abs(vectors[:, 0]), 1e-300)
    turns *= np.conj(turns[0])
    places = factorised(form[:inner, :inner].tocsc()).solve(-(form[:inner, inner:] @ turns))
    places = np.concatenate([[0.0], places])
    return np.stack([places.real, places.imag, np.angle(turns)], axis=1)


def lower_bound(poses: FloatArray, edges: EdgeArrays) -> float:
    """Return a lower bound of F over all poses; at a global optimum it equals F.

    For real multipliers m such that the form minus diag(0, m) has no negative eigenvalue, F >= sum(m). The multipliers
    of the poses are lowered together until a Cholesky-like factorisation proves this condition (SE-Sync, theorem 7).
    Poses that are not stationary, or only a local optimum, give a weak but valid bound.
    """
    count = len(poses)
    form = _form(edges, count)
    turns = np.exp(1j * poses[:, 2])
    moved = form @ np.concatenate([poses[:, 0] + 1j * poses[:, 1], turns])
    multipliers = (np.conj(turns) * moved[count:]).real
    shifted = (form - sparse.diags(np.concatenate([np.zeros(count), multipliers])))[1:, 1:].tocsc()
    mask = sparse.diags(np.concatenate([np.zeros(count - 1), np.ones(count)]))
    slack = 1e-9 * max(1.0, float(multipliers.max()))
    while not _positive(shifted + slack * mask):
        slack *= 10.0
    return float(multipliers.sum()) - slack * count


def polished(poses: FloatArray, edges: EdgeArrays, iterations: int = 30) -> FloatArray:
    """Return poses (N, 3) at the stationary point of F next to the given poses, by descending Gauss-Newton steps."""
    kappa, tau = sesync_weights(edges)
    best = sesync_objective(poses, edges)
    for _ in range(iterations):
        jacobian, residual = _linearised(poses, edges, kappa, tau)
        step = factorised((jacobian.T @ jacobian).tocsc()).solve(jacobian.T @ residual).reshape(-1, 3)
        moved = poses.copy()
        moved[1:] -= step
        value = sesync_objective(moved, edges)
        if value > best:
            return poses
        gain, poses, best = best - value, moved, value
        if gain < 1e-10 * best:
            break
    return poses


def _chordal(poses: FloatArray, edges: EdgeArrays) -> tuple[FloatArray, FloatArray]:
    """Return turn (E,) [rad] and offset (E, 2) [m], in world axes, between measured and present relative poses."""
    first, second = poses[edges.i], poses[edges.j]
    c, s = np.cos(first[:, 2]), np.sin(first[:, 2])
    x, y, theta = edges.i_from_j.T
    offset = second[:, :2] - first[:, :2] - np.stack([c * x - s * y, s * x + c * y], axis=1)
    return second[:, 2] - first[:, 2] - theta, offset


def _linearised(
    poses: FloatArray, edges: EdgeArrays, kappa: FloatArray, tau: FloatArray
) -> tuple[sparse.csr_matrix, FloatArray]:
    """Return the Jacobian (3E, 3N - 3) and residuals (3E,) whose squares sum to F; ||R(a) - 1||^2 is 8 sin^2(a / 2)."""
    turn, offset = _chordal(poses, edges)
    c, s = np.cos(poses[edges.i, 2]), np.sin(poses[edges.i, 2])
    x, y, _ = edges.i_from_j.T
    far, stiff = np.sqrt(tau), np.sqrt(8 * kappa)
    bend = stiff * np.cos(turn / 2) / 2
    count, row, i, j = len(edges), np.arange(len(edges)), 3 * edges.i, 3 * edges.j
    rows = [row, row, row, row + count, row + count, row + count, row + 2 * count, row + 2 * count]
    columns = [j, i, i + 2, j + 1, i + 1, i + 2, j + 2, i + 2]
    values = [far, -far, far * (s * x + c * y), far, -far, -far * (c * x - s * y), bend, -bend]
    jacobian = sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(3 * count, 3 * len(poses))
    )
    residual = np.concatenate([far * offset[:, 0], far * offset[:, 1], stiff * np.sin(turn / 2)])
    return jacobian[:, 3:], residual


def _form(edges: EdgeArrays, count: int) -> sparse.csc_matrix:
    """Return the Hermitian matrix (2N, 2N) whose form at (translations, rotations) is F."""
    kappa, tau = sesync_weights(edges)
    far, stiff = np.sqrt(tau), np.sqrt(2 * kappa)  # ||R - R'||^2 is twice the squared distance of complex numbers
    turn, offset = np.exp(1j * edges.i_from_j[:, 2]), edges.i_from_j[:, 0] + 1j * edges.i_from_j[:, 1]
    row, i, j = np.arange(len(edges)), edges.i, edges.j
    shape = (len(edges), 2 * count)
    moves = sparse.csr_matrix(
        (np.concatenate([far, -far, -far * offset]), (np.tile(row, 3), np.concatenate([j, i, count + i]))), shape
    )
    turns = sparse.csr_matrix(
        (np.concatenate([stiff, -stiff * turn]), (np.tile(row, 2), np.concatenate([count + j, count + i]))), shape
    )
    return (moves.conj().T @ moves + turns.conj().T @ turns).tocsc()


def factorised(matrix: sparse.csc_matrix) -> splu:
    """Return L D L^H as an LU factorisation with symmetric ordering and without off-diagonal pivoting."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _positive(matrix: sparse.csc_matrix) -> bool:
    """Return whether a Hermitian matrix is positive definite: all pivots of L D L^H are (Sylvester's law of inertia)."""
    try:
        factor = factorised(matrix.tocsc())
    except RuntimeError:  # a pivot is exactly zero
        return False
    untouched = bool((factor.perm_r == factor.perm_c).all())
    return untouched and bool((factor.U.diagonal().real > 0).all())
