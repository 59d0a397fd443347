"""The page of many maps: a row for each recording with its state, costs, and a small picture that leads to its report."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from waychair.files import write_text
from waychair.offline.report import STYLE
from waychair.types import Json

_PICTURE_SIDE = 160  # pixels
_OWN_STYLE = "td img { max-width: 10rem; max-height: 6rem; } tr.failed td { background: #d55e0018; }"
_HEAD = ("map", "recording", "state", "seconds", "CPU", "memory", "host")


def write_index(path: Path, report: Json) -> None:
    """Write the page of a report (`many_maps.ManyMaps.as_json`); the maps are in the folders beside it.

    Raises:
        OutputError: it cannot be written.
    """
    title = "waychair map-all"
    lead = (
        f"{report['done']} of {len(report['recordings'])} recordings are mapped, {report['kept']} of the results are of "
        f"earlier runs; {report['seconds']:.0f} s, {report['cpu_s']:.0f} s of CPU, at most "
        f"{report['peak_memory_mb']:.0f} MB a recording."
    )
    head = "".join(f'<th scope="col">{name}</th>' for name in _HEAD)
    rows = "\n".join(_row(path.parent, each) for each in report["recordings"])
    write_text(
        path,
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}{_OWN_STYLE}</style></head>\n<body><main><h1>{title}</h1><p>{lead}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table></main></body></html>\n",
        lasting=False,
    )


def _row(out: Path, row: Json) -> str:
    name, state = row["name"], row["state"]
    shown = html.escape(name)
    if state == "done":
        report = "report.html" if (out / name / "report.html").is_file() else "report.json"
        shown = f'<a href="{quote(name)}/{report}">{_picture(out / name / "map.pgm")}{shown}</a>'
    why = row.get("why", "")
    told = html.escape(state + (", kept" if row.get("kept") else "") + (f": {why}" if why else ""))
    costs = (
        [
            f"{row['seconds']:.1f} s",
            f"{row['cpu_s']:.1f} s",
            f"{row['peak_memory_mb']:.0f} MB",
            html.escape(row["host"]),
        ]
        if "seconds" in row
        else [""] * 4
    )
    cells = [shown, html.escape(row["path"]), told]
    numbers = "".join(f'<td class="number">{cell}</td>' for cell in costs[:3])
    plain = "".join(f"<td>{cell}</td>" for cell in cells)
    kind = "" if state == "done" else ' class="failed"'
    return f"<tr{kind}>{plain}{numbers}<td>{costs[3]}</td></tr>"


def _picture(path: Path) -> str:
    """Return a small picture of a map, inside the page; empty where it has none."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
    if image is None:
        return ""
    scale = _PICTURE_SIDE / max(image.shape)
    small = cv2.resize(image, None, fx=min(scale, 1.0), fy=min(scale, 1.0), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".png", np.ascontiguousarray(small))
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(data.tobytes()).decode()}"><br>' if done else ""
