"""The table of hazards names tests; a test that is renamed or removed must not leave a hole in it."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
HAZARDS = ROOT / "docs" / "safety" / "HAZARDS.md"
NAMED = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def rows() -> list[list[str]]:
    """The cells of each row of a hazard."""
    lines = [line for line in HAZARDS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "hazard"]


def test_every_hazard_has_a_cause_a_requirement_and_a_test() -> None:
    assert len(rows()) > 20
    for row in rows():
        assert len(row) == 4
        assert all(row), row
        assert NAMED.search(row[3]), row[0]


def test_every_test_that_is_named_exists() -> None:
    named = NAMED.findall(HAZARDS.read_text(encoding="utf-8"))
    for file, test in named:
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), f"{file}::{test}"
