"""Hospitals of any number of storeys for many chairs: a square of corridors with rooms and eight lifts on each."""

from __future__ import annotations

from waychair.maps.building.building_traffic import LOBBY_SLOTS
from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficLift, TrafficNode

SIDE = 7
"""Corridors in each direction."""

APART = 15.0
"""m between two corridors."""

LIFTS = {"A": (1, 1), "B": (3, 1), "C": (5, 1), "D": (1, 3), "E": (5, 3), "F": (1, 5), "G": (3, 5), "H": (5, 5)}
"""The crossing beside each lift."""

_PIECES = 4
"""Sections between two crossings, each with a room at its end."""

_RIDE_S, _STOREY_S = 20.0, 3.0
"""s of a ride with boarding, and for each storey."""


def hospital_traffic(storeys: int) -> TrafficGraph:
    """Return the traffic graph of a hospital; all corridors are single file, so that the order is all that helps."""
    nodes: list[TrafficNode] = []
    sections: list[Section] = []
    refuges: list[Refuge] = []
    lifts: dict[str, list[str]] = {}
    step = APART / _PIECES
    for number in range(storeys):
        storey = f"storey {number}"

        def name(x: float, y: float, number: int = number) -> str:
            return f"{number}:{x:g},{y:g}"

        lines = [((i * APART, 0.0), (0.0, 1.0)) for i in range(SIDE)] + [
            ((0.0, i * APART), (1.0, 0.0)) for i in range(SIDE)
        ]
        points: dict[str, tuple[float, float]] = {}
        for (x0, y0), (dx, dy) in lines:
            along = [(x0 + dx * step * k, y0 + dy * step * k) for k in range((SIDE - 1) * _PIECES + 1)]
            for k, (x, y) in enumerate(along):
                points[name(x, y)] = (x, y)
                if k > 0:
                    before = name(*along[k - 1])
                    sections.append(Section(f"{before} {name(x, y)}", before, name(x, y), step, 1.2))
                if k % _PIECES:
                    room = f"room {name(x, y)}"
                    place = (x + dy * 1.5, y + dx * 1.5)
                    nodes.append(TrafficNode(room, *place, storey))
                    sections.append(Section(f"door of {room}", name(x, y), room, 1.5, 0.9))
                    refuges.append(Refuge(room, room))
        nodes += [TrafficNode(each, x, y, storey) for each, (x, y) in points.items()]
        for lift, (i, j) in LIFTS.items():
            at, lobby = name(i * APART, j * APART), f"lobby {lift} {number}"
            x, y = points[at]
            nodes.append(TrafficNode(lobby, x + 1.0, y + 1.0, storey))
            sections.append(Section(f"way to {lobby}", at, lobby, 1.5, 1.2))
            refuges.append(Refuge(lobby, lobby, LOBBY_SLOTS, RefugeKind.BAY, waiting=True))
            lifts.setdefault(lift, []).append(lobby)
    for lift, stops in lifts.items():
        for k, one in enumerate(stops):
            for m in range(k + 1, len(stops)):
                ride = _RIDE_S + _STOREY_S * (m - k)
                sections.append(Section(f"lift {lift} {k} {m}", one, stops[m], 2.0, 1.1, delay_s=ride, lift=lift))
    return TrafficGraph(
        f"hospital of {storeys} storeys",
        tuple(nodes),
        tuple(sections),
        tuple(refuges),
        tuple(TrafficLift(lift, tuple(stops)) for lift, stops in lifts.items()),
    )
