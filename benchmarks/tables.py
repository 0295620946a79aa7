"""Tables of results for the terminal."""

from __future__ import annotations

import os
from collections.abc import Collection

from rich import box
from rich.markup import escape
from rich.table import Table


def make_table(title: str, *columns: str, left: Collection[str] = ()) -> Table:
    """Return an empty table; the columns named in `left` are aligned to the left.

    Titles and headings may contain units in square brackets, which rich would take for markup.
    """
    table = Table(title=escape(title), box=box.SIMPLE_HEAD)
    for column in columns:
        table.add_column(escape(column), justify="left" if column in left else "right")
    return table


def describe_load() -> str:
    """Return the machine's load average of the last minute and its number of cores."""
    return f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
