"""The part of a page's port that shows the behaviour cells as the cells node tells of them."""

from __future__ import annotations

import time
from typing import Any

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.cell_network import Network
from waychair.control.behaviours.drawing import network_picture
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.presets import shipped
from waychair.ros import topics
from waychair.ros.messages.cells import read_perception
from waychair.ros.nodes.node import ChairNode
from waychair.runtime.pages.perception_view import PerceptionView

_SILENT_NS = 2_000_000_000
"""Time after which a silent cells node counts as gone."""


class HeardCells:
    """The last word of the cells node; nothing while there is none."""

    _cells: tuple[int, PerceptionView] | None = None

    def _listen_to_cells(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._cells_body = body
        node.listen(topics.PERCEPTION, read_perception, self._take_cells, needed=False)

    def _take_cells(self, view: PerceptionView) -> None:
        self._cells = time.monotonic_ns(), view

    def perception(self) -> PerceptionView | None:
        """See `ChairPort`."""
        heard = self._cells
        return None if heard is None or time.monotonic_ns() - heard[0] > _SILENT_NS else heard[1]

    def network(self, name: str) -> str | None:
        """See `ChairPort`."""
        if self.perception() is None:
            return None
        wiring = shipped("default", PaperSettings(), self._cells_body).wiring
        return network_picture(wiring, name) if isinstance(wiring.nodes.get(name), Network) else None
