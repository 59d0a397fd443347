"""The drawing on the map in use: the folder is noted by a node's loop, and its files are read when somebody asks for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from waychair.errors import MapError, WaychairError
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.runtime.pages.chair_port import LayoutView


class MapInUse:
    """Places and zones of one map after another. `take` never waits; the other calls come from threads that may."""

    def __init__(self, folder: Path | None, complain: Callable[[str], object]) -> None:
        """`folder`: None while a map is made. `complain` is told once of a drawing that cannot be read.

        Raises:
            MapError, PlaceError, ZoneError: a file of the drawing is broken.
        """
        self.folder = folder
        self._complain, self._lock = complain, threading.Lock()
        self._known: tuple[Path, DrawingEditor | None] | None = (
            None if folder is None else (folder, DrawingEditor(folder))
        )
        """The folder that has been read, and its editor, None for a broken drawing."""

    def take(self, folder: Path) -> bool:
        """Use another map from now on; return False if it is the same."""
        changes, self.folder = folder != self.folder, folder
        return changes

    def layout(self) -> LayoutView | None:
        """Return the drawing; None if there is no drawing."""
        with self._lock:
            editor = self._editor()
            return (
                None
                if editor is None
                else LayoutView(dict(editor.drawing.places), editor.drawing.zones, editor.undoable)
            )

    def change(self, change: Callable[[DrawingEditor], None]) -> None:
        """Change the drawing.

        Raises:
            WaychairError: a map is being made, its drawing is broken, or the change is refused.
        """
        with self._lock:
            if self.folder is None:
                raise MapError("the map is being made: save it, and start the chair on it first")
            editor = self._editor()
            if editor is None:
                raise MapError(f"the drawing of {self.folder} is broken: mend its files first")
            change(editor)

    def _editor(self) -> DrawingEditor | None:
        folder = self.folder
        if folder is None:
            return None
        if self._known is None or self._known[0] != folder:
            try:
                self._known = folder, DrawingEditor(folder)
            except WaychairError as error:
                self._complain(f"{error}; the page draws on no map")
                self._known = folder, None
        return self._known[1]
