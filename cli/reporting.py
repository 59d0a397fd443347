"""`waychair report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def report_command(*, paper: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)]) -> None:
    """Print the figures of a map's memory of places beside the published ones.

    Parameters
    ----------
    paper
        One or two map folders, made with pictures. Prints Tables 1 to 3 of Pai et al. 2026, with the first map beside
        its second floor, the second beside its basement. If a published count is ambiguous, both readings are shown.
    """
    from rich.table import Table

    from waychair.cli.options.arguments import BadArgument
    from waychair.cli.options.tables import print_table
    from waychair.offline.paper_tables import paper_tables, read_report

    if not 1 <= len(paper) <= 2:
        raise BadArgument(f"--paper takes one or two map folders, not {len(paper)}")
    for table in paper_tables([read_report(folder) for folder in paper]):
        drawn = Table(*table.heads, title=table.title, title_justify="left")
        for row in table.rows:
            drawn.add_row(*row)
        print_table(drawn)
