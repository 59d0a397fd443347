"""The map of a live chair: its grid, and the drawings that its page changes, on disk and in the driving chair."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from waychair.errors import WaychairError
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part
from waychair.maps.folders.map_drawing import DrawingEditor, MapDrawing
from waychair.maps.folders.map_files import load_map, save_map
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.runtime.chair import Chair
from waychair.runtime.pages.chair_port import LayoutView, PortAnswer
from waychair.simulation.plan.world import World
from waychair.types import OccupancyGrid


class LiveMap:
    """A map folder in use. `revision` counts changes of the grid, `layout_revision` those of places and zones."""

    def __init__(self, folder: Path) -> None:
        """
        Raises:
            WaychairError: the map cannot be read.
        """
        self.folder = folder
        self.revision = self.layout_revision = 1
        self._editor = DrawingEditor(folder)
        self.grid = load_map(folder)
        self._lock = threading.Lock()
        self._prepared: DrawnMap | None = None  # of the drawing as it is, since the first change

    @property
    def revisions(self) -> tuple[int, int]:
        """Both revisions."""
        return self.revision, self.layout_revision

    @property
    def drawing(self) -> MapDrawing:
        """Places, zones and erased cells."""
        return self._editor.drawing

    def scanned(self) -> OccupancyGrid:
        """Return the map without the depth camera's cells, for the localiser."""
        return scanned_part(self.grid, load_depth_layer(self.folder, self.grid))

    def layout(self) -> LayoutView:
        """Return places and zones for a page."""
        with self._lock:
            drawn = self._editor.drawing
            return LayoutView(dict(drawn.places), drawn.zones, self._editor.undoable)

    def change(
        self,
        change: Callable[[DrawingEditor], None],
        done: str,
        chair: Chair,
        tell: Callable[[Callable[[], None]], None],
    ) -> PortAnswer:
        """Apply a change of places, zones or erased cells to the files, then to the chair, which replans its drive.

        `tell` runs the chair's part in its thread. Return `done`, or why it was refused.
        """
        with self._lock:
            before = self.drawing
            try:
                change(self._editor)
                now = self.drawing
                erased, known = not now.has_same_erased(before), None
                if erased:
                    self.grid = load_map(self.folder, lambda _: None)
                    self.revision += 1
                    known = chair.known(self.scanned())
                prepared = self._prepared
                if prepared is None or erased or not now.has_same_zones(before):
                    prepared = self._prepared = chair.drawn(self.grid, now.zones)
                tell(lambda: chair.redraw(prepared, now.zones, now.places, known))
            except WaychairError as error:
                return PortAnswer(False, str(error))
            self.layout_revision += 1
        return PortAnswer(True, done)


@contextmanager
def plan_folder(world: World) -> Iterator[Path]:
    """Yield a temporary map folder with the world's plan and places."""
    with tempfile.TemporaryDirectory(prefix="waychair-") as name:
        save_map(Path(name), world.grid)
        save_places(Path(name), {place.name: place for place in world.places})
        yield Path(name)
