"""The report of a guided drive: symbols said and felt, the path, the touches, the caps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waychair.errors import OutputError
from waychair.files import os_error_text, write_json, write_text
from waychair.trials.guiding.guided import GuidedRecord, GuidedSetup
from waychair.types import Json

NOTE = "A simulated driver is not a blind driver: this shows faults of the guidance, never that it helps a person."

_EVERY = 10
"""Ticks between two rows of the report."""


def felt_wrongly(record: GuidedRecord) -> int:
    """Return how many of the symbols told were felt as another or not at all; also one that a warning cut short."""
    told = [each for each in record.told if not each.symbol.startswith("obstacle")]
    wrong, felt = 0, list(record.felt)
    for k, each in enumerate(told):
        until = told[k + 1].stamp_ns if k + 1 < len(told) else None
        within = [f for f in felt if f.ended_ns > each.stamp_ns and (until is None or f.ended_ns <= until)]
        wrong += not any(f.symbol == each.symbol for f in within)
    return wrong


def report(record: GuidedRecord, setup: GuidedSetup) -> Json:
    """Return the report as plain numbers and words.

    Rows of `path`: s, x, y [m], yaw [rad]; of `caps_and_stick`: s, caps to the front, the rear, the left and the right, and the
    stick ahead and to the left, in shares of the swing.
    """
    seconds = max(record.seconds, 1e-9)
    held = (record.caps[:, 0] < record.stick[:, 0]) | (record.caps[:, 1] < -record.stick[:, 0])
    turned = (record.caps[:, 2] < record.stick[:, 1]) | (record.caps[:, 3] < -record.stick[:, 1])
    return {
        "note": NOTE,
        "goal": record.goal.name,
        "level": setup.level.value,
        "chair": setup.body.chair_id,
        "sensors": setup.sensors.value,
        "layout": setup.layout,
        "seed": setup.seed,
        "reached": record.reached,
        "reason": record.reason,
        "seconds": round(record.seconds, 2),
        "distance_m": round(record.distance_m, 2),
        "planned_m": round(record.planned_m, 2),
        "error_m": round(record.error_m, 3),
        "plans": record.plans,
        "contacts": [
            {
                "seconds": round(each.stamp_ns * 1e-9, 2),
                "with": each.kind.value,
                "at": [round(each.x, 3), round(each.y, 3)],
                "speed": round(each.speed, 3),
            }
            for each in record.contacts
        ],
        "announced": list(record.announced),
        "symbols": len(record.told),
        "symbols_per_s": round(len(record.told) / seconds, 3),
        "felt_wrongly": felt_wrongly(record),
        "held_by_caps_s": round(float((held | turned).mean()) * seconds, 1),
        "learnt": {name: round(value, 4) for name, value in record.learnt.figures().items()},
        "path": np.round(np.column_stack([record.times_s, record.truth])[::_EVERY], 3).tolist(),
        "caps_and_stick": np.round(np.column_stack([record.times_s, record.caps, record.stick])[::_EVERY], 3).tolist(),
    }


def save_report(record: GuidedRecord, setup: GuidedSetup, folder: Path) -> None:
    """Write guided.json and symbols.csv into a folder.

    Raises:
        OutputError: they cannot be written.
    """
    rows = ["seconds,kind,symbol,reason"]
    rows += [f'{each.stamp_ns * 1e-9:.3f},said,{each.symbol},"{each.reason}"' for each in record.told]
    rows += [f"{each.ended_ns * 1e-9:.3f},felt,{each.symbol or 'not understood'}," for each in record.felt]
    rows[1:] = sorted(rows[1:], key=lambda row: float(row.partition(",")[0]))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "guided.json", report(record, setup))
        write_text(folder / "symbols.csv", "\n".join(rows) + "\n")
    except OSError as error:
        raise OutputError(f"the report cannot be written to {folder}: {os_error_text(error)}") from error


def summary(record: GuidedRecord, setup: GuidedSetup) -> str:
    """Return the drive in a few lines of words."""
    values = report(record, setup)
    ended = f"reached {record.goal.name}" if record.reached else f"did not reach {record.goal.name} ({record.reason})"
    touch = f"{values['symbols']} symbols, {values['felt_wrongly']} of them felt wrongly"
    way = f"{values['distance_m']:.1f} m for {values['planned_m']:.1f} m planned"
    return (
        f"{ended} in {values['seconds']:.0f} s, {way}\n"
        f"{touch}; held by the caps for {values['held_by_caps_s']:.0f} s; {len(record.contacts)} contacts\n"
        f"{NOTE}"
    )
