"""Floor plans of a hall with four walls, as text, for tests that need a small building."""

from __future__ import annotations


def hall_plan(width: float, depth: float, further: str) -> str:
    """A hall of this size [m] with the chair 1.5 m inside; `further` YAML follows its walls and may add more."""
    return f"""\
name: hall
size: [{width}, {depth}]
start: [1.5, 3.0, 0.0]
walls:
  - {{start: [0.0, 0.0], end: [{width}, 0.0]}}
  - {{start: [{width}, 0.0], end: [{width}, {depth}]}}
  - {{start: [{width}, {depth}], end: [0.0, {depth}]}}
  - {{start: [0.0, {depth}], end: [0.0, 0.0]}}
{further}"""


BOXES = """\
boxes:
  - {centre: [4.0, 5.5], size: [1.2, 0.6]}
  - {centre: [5.5, 0.5], size: [0.6, 0.6]}
"""


def mapped_hall(places: str, routes: str = "") -> str:
    """A hall of 8 by 6 m with boxes and a route that maps it; `places` and further `routes` are indented lines of YAML."""
    return hall_plan(8.0, 6.0, f"{BOXES}places:\n{places}routes:\n  mapping: [[6.0, 3.0], [2.0, 3.0]]\n{routes}")
