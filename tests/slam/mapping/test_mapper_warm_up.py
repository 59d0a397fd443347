"""The kernels that a mapper needs only in the middle of a drive are there before it begins."""

from numba.core.dispatcher import Dispatcher

from waychair.slam.graph import block_cholesky, edges, least_squares, shortest_paths
from waychair.slam.mapping.mapper_warm_up import warm_up
from waychair.slam.scan import reference_surfaces, relocaliser, scan_agreement, scan_matching, scan_points

_INNER = {
    "_grown",
    "_normal",
    "_noise",
    "_score",
    "_turn",
    "nearest_surface",
    "_turned_cells",
    "_block_score",
    "_keep",
    "_open",
}
"""Kernels that only other kernels call."""


def test_every_kernel_of_a_mapper_is_loaded() -> None:
    warm_up()
    rooms = (
        block_cholesky, edges, least_squares, shortest_paths,
        reference_surfaces, relocaliser, scan_agreement, scan_matching, scan_points,
    )  # fmt: skip
    kernels = {
        each for room in rooms for each in vars(room).values()
        if isinstance(each, Dispatcher) and each.py_func.__module__ == room.__name__
    }  # fmt: skip
    missing = {each.py_func.__name__ for each in kernels if not each.signatures}
    assert missing <= _INNER
    assert len(kernels) > len(_INNER)
