"""Tables 1 to 3 of the wheelchair paper (Pai et al. 2026, section 4.1) for our maps, beside the paper's figures.

The paper does not define its counts, and they contradict each other: 1498 + 427 nodes in WM and LTM from 1050 frames,
870 + 132 from 550. So each count is given in two readings, as the state at the end of the drive and as the number of
events since its beginning, and each row names its reading (`MemoryCounts` shows why neither explains the paper's).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waychair.errors import MapError, MapNotFound
from waychair.types import Json

_FLOORS = (
    {"distance": 203.243, "words": 630_525, "frames": 1050, "stm": 10, "wm": 1498, "ltm": 427, "closures": 3},
    {"distance": 140.414, "words": 354_702, "frames": 550, "stm": 10, "wm": 870, "ltm": 132, "closures": 4},
)
_PER_FRAME = {
    "words": (818.0, 867.0, 5.99),
    "extraction_ms": (17.26, 22.98, 33.14),
    "words_ms": (131.61, 122.98, -6.55),
    "total_ms": (157.91, 144.34, -8.59),
}


@dataclass(frozen=True, slots=True)
class PaperTable:
    """A table: title, column heads, and rows with one cell per head."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def read_report(folder: Path) -> Json:
    """Return the report of a map with a memory of places.

    Raises:
        MapNotFound: the folder holds no report.json.
        MapError: the report cannot be read, or the map was made without pictures.
    """
    path = folder / "report.json"
    if not path.is_file():
        raise MapNotFound(f"{folder} holds no report.json: give the folder that `waychair map` wrote")
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise MapError(f"cannot read {path}: {error}") from error
    if not isinstance(report, dict) or "memory" not in report:
        raise MapError(f"{folder} was mapped without pictures, so that it has no memory to report: use --vision on")
    return report


def paper_tables(reports: Sequence[Json]) -> tuple[PaperTable, ...]:
    """Return Tables 1 and 2 for the reports of one or two maps, the second floor's first, and Table 3 for both."""
    names = ("second floor", "basement")
    counts = [_counts(k + 1, names[k], report, _FLOORS[k]) for k, report in enumerate(reports[:2])]
    return (*counts, _per_frame([report["memory"]["per_picture"] for report in reports[:2]]))


def _counts(number: int, name: str, report: Json, paper: dict[str, Any]) -> PaperTable:
    told = report["memory"]
    memory = told["memory"]
    closed = f"{told['links']['by appearance']} links by appearance, {told['links']['on known ground']} on known ground"
    rows = (
        ("mapping distance, m", f"{report['distance_m']:.3f}", "", f"{paper['distance']}", "distance driven"),
        (
            "words in the vocabulary", str(memory["words"]), str(told["words_made"]), str(paper["words"]),
            "in the vocabulary; ever made",
        ),
        ("words seen", str(told["references"]), "", "", "features with a word, of all frames"),
        ("frames", str(memory["frames"]), str(told["pictures"]), str(paper["frames"]), "nodes ever made; pictures"),
        ("STM nodes", str(memory["stm"]), "", str(paper["stm"]), "present"),
        ("WM nodes", str(memory["wm"]), str(memory["entered_wm"]), str(paper["wm"]), "present; entries"),
        ("LTM nodes", str(memory["ltm"]), str(memory["transferred"]), str(paper["ltm"]), "present; transfers"),
        ("retrieved", "", str(memory["retrieved"]), "", "returns of nodes from the LTM"),
        ("loop closures", str(told["revisits"]), closed, str(paper["closures"]), "returns of the chair; links"),
    )  # fmt: skip
    heads = ("", "at the end", "since the beginning", "paper", "what is counted")
    return PaperTable(f"Table {number}: {name}", heads, rows)


def _per_frame(measured: Sequence[Json]) -> PaperTable:
    names = {
        "words": "words per frame",
        "extraction_ms": "feature extraction, ms",
        "words_ms": "new words, ms",
        "total_ms": "whole frame, ms",
    }
    rows = []
    for key, name in names.items():
        values = [float(each[key]) for each in measured]
        grown = 100.0 * (values[1] / values[0] - 1.0) if len(values) == 2 and values[0] else None
        own = [f"{value:.2f}" for value in values] + [""] * (2 - len(values))
        rows.append((name, *own, "" if grown is None else f"{grown:+.2f}", *(f"{x:g}" for x in _PER_FRAME[key])))
    heads = ("mean per frame", "first map", "second map", "growth, %")
    paper = ("paper: second floor", "paper: basement", "paper: growth, %")
    return PaperTable("Table 3: time per frame (CPU)", (*heads, *paper), tuple(rows))
