"""The part of a `ChairPort` that edits places, zones and map, for a chair in this program and one behind ROS."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from waychair.errors import WaychairError
from waychair.maps.drawn.places import check_place, find
from waychair.maps.drawn.zones import Zone
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.runtime.pages.chair_port import ChairView, GoalView, LayoutView, PortAnswer
from waychair.runtime.pages.chair_story import check_zone
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

NO_GUIDE = "this chair has no building to guide in: open the page with --building FOLDER"
NOT_ASKED = "the chair does not ask which storey this is"


class DrawingPort(ABC):
    """Checks each change of places, zones and map; the subclass's `_drawn` makes it."""

    @property
    @abstractmethod
    def outline(self) -> FloatArray:
        """See `ChairPort`."""

    @abstractmethod
    def view(self) -> ChairView:
        """See `ChairPort`."""

    @abstractmethod
    def grid(self) -> OccupancyGrid | None:
        """See `ChairPort`."""

    @abstractmethod
    def layout(self) -> LayoutView:
        """See `ChairPort`."""

    @abstractmethod
    def relocalise(self, map_from_base: Pose2 | None = None) -> PortAnswer:
        """See `ChairPort`."""

    @abstractmethod
    def _drawn(self, change: Callable[[DrawingEditor], None], done: str) -> PortAnswer:
        """Make a change, pass it to the navigator, and answer `done` or why it was refused."""

    def goals(self) -> Sequence[GoalView]:
        """See `ChairPort`; a chair that knows one map has none beside its places."""
        return ()

    def answer_storey(self, storey: str) -> PortAnswer:
        """See `ChairPort`; a chair that knows one map never asks."""
        return PortAnswer(False, NOT_ASKED)

    def start_at(self, goal: str) -> PortAnswer:
        """See `ChairPort`; a place of the map in use."""
        try:
            return self.relocalise(find(self.layout().places, goal).pose)
        except WaychairError as error:
            return PortAnswer(False, str(error))

    def guide(self, goal: str, level: int) -> PortAnswer:
        """See `ChairPort`; a chair that knows one map guides nobody."""
        return PortAnswer(False, NO_GUIDE)

    def end_guide(self) -> PortAnswer:
        """See `ChairPort`."""
        return PortAnswer(False, NO_GUIDE)

    def place_here(self, name: str, tolerance_m: float, tolerance_rad: float, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""
        view = self.view()
        if view.map_from_base is None or view.localisation is LocalisationState.LOST:
            return PortAnswer(False, "the chair does not know where it is: drive it to a known place first")
        return self.set_place(Place(name.strip(), view.map_from_base, tolerance_m, tolerance_rad), replaces)

    def set_place(self, place: Place, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""

        def change(drawings: DrawingEditor) -> None:
            grid = self.grid()
            if grid is not None:
                check_place(grid, place)
            drawings.set_place(place, replaces)

        return self._drawn(change, f"saved {place.name}")

    def rename_place(self, name: str, new_name: str) -> PortAnswer:
        """See `ChairPort`."""
        return self._drawn(lambda drawings: drawings.rename_place(name, new_name), f"renamed {name} to {new_name}")

    def remove_place(self, name: str) -> PortAnswer:
        """See `ChairPort`."""
        return self._drawn(lambda drawings: drawings.remove_place(name), f"removed {name}")

    def set_zone(self, zone: Zone, replaces: bool = False) -> PortAnswer:
        """See `ChairPort`."""

        def change(drawings: DrawingEditor) -> None:
            check_zone(zone, self.view().map_from_base, self.outline)
            drawings.set_zone(zone, replaces)

        return self._drawn(change, f"drew {zone.name}")

    def remove_zone(self, name: str) -> PortAnswer:
        """See `ChairPort`."""
        return self._drawn(lambda drawings: drawings.remove_zone(name), f"removed {name}")

    def erase(self, polygon: FloatArray) -> PortAnswer:
        """See `ChairPort`."""
        return self._drawn(lambda drawings: drawings.erase(polygon), "erased")

    def undo(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._drawn(lambda drawings: drawings.undo(), "undone")
