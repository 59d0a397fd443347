"""Public interface of the pose graph: nodes and edges as plain data, their optimisation, and g2o files.

The parts are `edges` (the data), `least_squares` with its `block_cholesky`, `pose_synchronisation` (initialisation and
optimality proofs), `robust_optimisation` (false loops) with `loop_groups` (loops that agree), `pose_graph` (a graph that
grows) with `judgement` (its loops in doubt, a piece at a time), `g2o_files`, and `spatial_least_squares` (graphs in space,
which `slam/rgbd/` uses).
"""

from waychair.slam.graph.edges import Edge, EdgeKind, chi_square, residuals
from waychair.slam.graph.g2o_files import read_g2o, write_g2o
from waychair.slam.graph.robust_optimisation import RejectedLoop, RejectionReason, Solution, solve

__all__ = [
    "Edge",
    "EdgeKind",
    "RejectedLoop",
    "RejectionReason",
    "Solution",
    "chi_square",
    "read_g2o",
    "residuals",
    "solve",
    "write_g2o",
]
