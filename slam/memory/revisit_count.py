"""The count of returns to known places, as the paper on Wheelchair SLAM counts loop closures."""

from __future__ import annotations

import numpy as np

from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.nodes import LOOPS


def revisits(memory: NodeMemory, near: float, pause: int) -> int:
    """Count the returns to known places: runs of nodes with links of less than `near` [m] to earlier nodes.

    A run ends where more than `pause` nodes without such a link follow. This is the paper's number of loop closures:
    one for each time that an area is entered again, whatever the number of links in it.
    """
    count, last = 0, -np.inf
    for node in memory.skeleton.ids():
        loops = memory.skeleton.links(node, LOOPS)
        if any(link.j < node and np.hypot(link.i_from_j.x, link.i_from_j.y) <= near for link in loops):
            count += node - last > pause
            last = node
    return count
