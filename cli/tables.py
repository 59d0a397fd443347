"""Tables on standard output."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

WIDTH_OF_A_PIPE = 200
"""Columns for a table that goes to a file or another program, where nothing should be broken over lines."""


def print_table(table: Table) -> None:
    """As wide as the terminal."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else WIDTH_OF_A_PIPE).print(table)
