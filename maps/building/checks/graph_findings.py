"""Findings of the checks, and the surroundings that a building's graph is checked in."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from waychair.maps.drawn.zones import Zone
from waychair.types import OccupancyGrid, Place


class FindingSeverity(enum.StrEnum):
    """An error forbids driving by the graph; a warning does not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class GraphFinding:
    """A fault: its code (E1 to E18, W1 to W3), severity, place (an address), and a sentence with the remedy."""

    code: str
    severity: FindingSeverity
    place: str
    sentence: str
    remedy: str


Driven = Callable[[str, tuple[float, float], tuple[float, float]], float | None]
"""The length [m] that the chair drives on a storey between two points [m, m] of its map, None if there is no way."""


@dataclass(frozen=True, slots=True)
class GraphSurroundings:
    """The surroundings against which a graph is checked; parts that are not given are not checked.

    `width`, `length` [m] of the chair's body; `grids` and `places` by storey; `driven` asks the grid planner; `missing`
    are the storeys whose map folder is missing; `moved` are those whose map was bent since the graph was saved;
    `turns` says whether the chair can turn round at a point of a storey's map; `zones` are those of the maps;
    `stale_tables` says that the tables are older than the graph; `guides` that step guidance is on.
    """

    width: float | None = None
    length: float | None = None
    grids: Mapping[str, OccupancyGrid] = field(default_factory=dict)
    places: Mapping[str, Mapping[str, Place]] = field(default_factory=dict)
    zones: Mapping[str, Sequence[Zone]] = field(default_factory=dict)
    driven: Driven | None = None
    turns: Callable[[str, tuple[float, float]], bool] | None = None
    missing: frozenset[str] = frozenset()
    moved: frozenset[str] = frozenset()
    stale_tables: bool = False
    guides: bool = False


NO_SURROUNDINGS = GraphSurroundings()
"""Only the graph itself is checked."""


def error(code: str, place: object, sentence: str, remedy: str) -> GraphFinding:
    """Return an error."""
    return GraphFinding(code, FindingSeverity.ERROR, str(place), sentence, remedy)


def warning(code: str, place: object, sentence: str, remedy: str) -> GraphFinding:
    """Return a warning."""
    return GraphFinding(code, FindingSeverity.WARNING, str(place), sentence, remedy)
