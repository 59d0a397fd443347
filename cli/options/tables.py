"""Tables on standard output."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

WIDTH_OF_A_PIPE = 200
"""Width [columns] of a table in a file or pipe, where lines should not be wrapped."""


def print_table(table: Table) -> None:
    """Print a table, as wide as the terminal."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else WIDTH_OF_A_PIPE).print(table)
