"""Commands that report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def report_command(*, paper: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)]) -> None:
    """Print what a map's memory of places came to, beside the published figures.

    Parameters
    ----------
    paper
        One or two map folders, made with pictures: Tables 1 to 3 of Pai et al. 2026 of each, the first beside its
        second floor, the second beside its basement. Every count says what it is; where it can be read in two ways,
        both are there.
    """
    from rich.table import Table

    from waychair.cli.arguments import BadArgument
    from waychair.cli.tables import print_table
    from waychair.runtime.paper_tables import paper_tables, read_report

    if not 1 <= len(paper) <= 2:
        raise BadArgument(f"--paper takes one or two map folders, not {len(paper)}")
    for table in paper_tables([read_report(folder) for folder in paper]):
        drawn = Table(*table.heads, title=table.title, title_justify="left")
        for row in table.rows:
            drawn.add_row(*row)
        print_table(drawn)
