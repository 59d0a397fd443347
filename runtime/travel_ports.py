"""What a journey over several storeys needs: a chair that travels, and the buttons of the lifts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from waychair.control.safety.stops import Halt
from waychair.maps.drawn.zones import Zone
from waychair.runtime.chair import ChairSettings, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.types import Goal, OccupancyGrid, Place, Pose2


class TravellingChair(Protocol):
    """A chair that travels: a `Chair`, or one whose parts are processes of their own. See the methods of `Chair`."""

    @property
    def settings(self) -> ChairSettings: ...
    @property
    def ready(self) -> bool: ...
    @property
    def waits(self) -> bool: ...
    @property
    def odom_from_base(self) -> Pose2: ...
    def go(self, goal: Goal, *further: Goal) -> None: ...
    def confirm(self) -> None: ...
    def cancel(self) -> None: ...
    def stop(self) -> None: ...
    def pause(self) -> bool: ...
    def go_on(self) -> bool: ...
    def relocalise(self, map_from_base: Pose2 | None) -> None: ...
    def doubt_storey(self, *, certain: bool) -> None: ...
    def prepared_storey(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        zones: Sequence[Zone] = (),
        scanned: OccupancyGrid | None = None,
    ) -> Any: ...
    def change_storey(self, storey: str, prepared: Any, map_from_base: Pose2 | None) -> None: ...
    def step(self, now_ns: int, messages: Iterable[ChairMessage], other_halts: Iterable[Halt] = ()) -> ChairState: ...


class LiftPort(Protocol):
    """The buttons of the lifts: pressed by a person who is told to, or by a building's adapter."""

    def call(self, lift: str, storey: str) -> None:
        """Press a storey's button, in the hall there or in the cabin."""

    def hold(self, lift: str, held: bool) -> None:
        """Keep the door open, or no longer."""

    def said(self, lift: str) -> str | None:
        """Return the storey at which the lift says its car stands; None if it says nothing."""
